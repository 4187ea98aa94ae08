"""Capstan friction test of a column of filaments: quasi-static model, identification, the engine's cross-checks."""
