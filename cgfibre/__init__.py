"""cgfibre: discrete-element compaction of fibre bundles, tows and fabrics with LAMMPS."""
