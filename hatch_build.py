"""Build hook: compile the LAMMPS plugin into the wheel where there is a compiler; without one the wheel is pure."""

from __future__ import annotations

import os
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CustomBuildHook(BuildHookInterface):
    """Compiles in the checkout (what an editable install uses) and lets a wheel carry what came out."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, or say what is missing: never a reason for the install to fail."""
        os.environ.pop("CGFIBRE_LMP", None)  # a wheel is for the LAMMPS wheel
        sys.path.insert(0, self.root)
        from cgfibre.engine.plugin import build_plugin
        from cgfibre.errors import CgfibreError

        try:
            plugin = build_plugin(note=self.app.display_info)
        except (CgfibreError, OSError) as error:
            self.app.display_warning(f"cgfibre is installed without its LAMMPS plugin: {error}")
            return
        if version == "editable":
            return
        # any Python, this platform; a library of the user's cache comes to where the package looks first
        build_data["pure_python"] = False
        build_data["tag"] = "py3-none-" + sysconfig.get_platform().replace("-", "_").replace(".", "_")
        folder = Path("cgfibre", "plugin", "lib", plugin.abi.key)
        for path in (plugin.library, plugin.library.with_suffix(".json")):
            build_data["force_include"][str(path)] = str(folder / path.name)
