"""docs/verification.md: the engine's decks against closed forms, as measured by the tests.

python analysis/verification.py
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HEAD = """# The engine against closed forms

Written by `python analysis/verification.py` from `tests/test_engine_closed_forms.py` (part of `make test`): the decks
of this package, run by LAMMPS, beside the closed forms of `cgfibre.mechanics`. Chains err with the square of spacing
over length, 2 (s/L)^2 for a simply supported filament; rods err less than 1e-4.

| what | quantity | measured | closed form | relative error |
|---|---|---|---|---|
"""


def main() -> None:
    """Run the tests and write the table; a failing test fails the script."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        subprocess.run(
            [
                sys.executable,
                "-m",
                "pytest",
                "-q",
                "tests/test_engine_closed_forms.py",
                "-o",
                "junit_family=xunit1",
                f"--junitxml={report}",
            ],
            cwd=ROOT,
            check=True,
        )
        notes = [
            p.attrib["value"].split("|")
            for p in ET.parse(report).getroot().iter("property")
            if p.attrib["name"] == "measured"
        ]
    lines = []
    for what, quantity, value, exact in sorted({tuple(note) for note in notes}):
        lines.append(f"| {what} | {quantity} | {value} | {exact} | {float(value) / float(exact) - 1:+.1e} |\n")
    (ROOT / "docs" / "verification.md").write_text(HEAD + "".join(lines))


if __name__ == "__main__":
    main()
