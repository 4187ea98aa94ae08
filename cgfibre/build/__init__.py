"""Builders: scene to FilamentSystem, pure functions of a spec and a random generator."""
