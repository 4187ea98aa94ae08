"""LAMMPS: FilamentSystem and plan to record and frames. The only place that knows the engine."""
