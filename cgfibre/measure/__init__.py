"""Arrays to numbers: compaction curves, filament distribution, guards. No paths."""
