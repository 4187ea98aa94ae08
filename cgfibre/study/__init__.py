"""Studies: a sweep of scenes, several specimens each, compared in one table and one plot (the verb ``study``)."""
