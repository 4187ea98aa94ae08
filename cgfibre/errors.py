"""Errors that a user meets, each with the exit code of the command line (interface: 2 input, 3 engine)."""

from __future__ import annotations


class CgfibreError(Exception):
    """Base of every error the package raises on purpose; ``exit_code`` is what the command line returns."""

    exit_code = 1


class InputError(CgfibreError):
    """The input is wrong: names the key, the value and what was expected."""

    exit_code = 2

    def __init__(self, key: str, value: object, expected: str) -> None:
        self.key, self.value, self.expected = key, value, expected
        super().__init__(f"{key} = {value!r}: expected {expected}")


class EngineError(CgfibreError):
    """LAMMPS stopped: carries the reason and the remedy; what was computed stays in the run's folder."""

    exit_code = 3

    def __init__(self, reason: str, remedy: str) -> None:
        self.reason, self.remedy = reason, remedy
        super().__init__(f"{reason}\nremedy: {remedy}")


class StoreError(CgfibreError):
    """A results file cannot be read: missing, cut short or of another schema version."""

    exit_code = 2
