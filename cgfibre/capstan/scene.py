"""The scene of a capstan test: ``[filament]`` and ``[capstan]``, validated as other scenes are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tomli_w
from pydantic import model_validator

from cgfibre import units
from cgfibre.capstan.column import LARGEST_TURN, Column
from cgfibre.errors import InputError
from cgfibre.mechanics.stick_slip import StickSlipLaw
from cgfibre.scene import Filament, Table
from cgfibre.scene_reading import read_tables, validated
from cgfibre.scene_values import Value, refusal

Length = Annotated[float, Value("um", above=0.0, most=1e7)]
Time = Annotated[float, Value("us", above=0.0, most=1e10)]
Coefficient = Annotated[float, Value(above=0.0, most=2.0)]


class Interface(Table):
    """``[capstan.pulley]``, ``[capstan.between]``: a stick-slip law (Eqs 4-3); defaults as in the thesis."""

    mu_s0: Coefficient
    mu_s: Coefficient
    mu_k: Coefficient
    critical_slip: Length = 20.0
    drop_slip: Length = 5.0
    restick: Annotated[float, Value(above=0.0, most=1.0)] = 0.05
    frequency: Annotated[float, Value("MHz", above=0.0, most=1.0)] = 3.97e-6

    @model_validator(mode="after")
    def _falling(self) -> Interface:
        if self.mu_s > self.mu_s0:
            raise refusal("mu_s", self.mu_s, f"at most mu_s0, {self.mu_s0:g}")
        if self.mu_k > self.mu_s:
            raise refusal("mu_k", self.mu_k, f"at most mu_s, {self.mu_s:g}")
        return self

    def law(self, speed: float) -> StickSlipLaw:
        """The law at a speed of the test, um/us."""
        return StickSlipLaw(
            self.mu_s0,
            self.mu_s,
            self.mu_k,
            self.critical_slip,
            self.drop_slip,
            self.frequency,
            speed,
            self.restick,
        )


class Dynamic(Table):
    """``[capstan.dynamic]``: the run in LAMMPS, of masses ``mass_scaling`` times the real ones."""

    mass_scaling: Annotated[float, Value(least=1.0, most=1e12)] = 1e7
    duration: Time = 4e5


class Capstan(Table):
    """``[capstan]``: the rig, the column, the pull; quantities of :class:`cgfibre.capstan.column.Column`."""

    model: Literal["column", "bundle"] = "column"
    filaments: Annotated[int, Value(whole=True, least=1, most=100)] = 10
    pulley_radius: Length = 19_000.0
    wrap: Annotated[float, Value("rad", above=0.0, most=20.0)]
    free_length: Length = 10_000.0
    tension: Annotated[float, Value("nN", above=0.0)]
    speed: Annotated[float, Value("um/us", above=0.0, most=10.0)] = 1.6e-4
    duration: Time = 2e6
    nodes: Annotated[int, Value(whole=True, least=2, most=1000)] = 30
    step: Time = 2e3
    pulley: Interface
    between: Interface
    dynamic: Dynamic = Dynamic()

    @model_validator(mode="after")
    def _consistent(self) -> Capstan:
        least = math.ceil(self.wrap / LARGEST_TURN)
        if self.nodes < least:
            raise refusal("nodes", self.nodes, f"{least} or more on this wrap: half a radian a node at most")
        if not 1e-6 * self.duration <= self.step <= self.duration:
            whole = units.format(self.duration, "us")
            raise refusal("step", self._shown("step"), f"at most capstan.duration, {whole}, and a millionth at least")
        return self


class CapstanScene(Table):
    """A capstan friction test, in engine units."""

    name: str = ""
    description: str = ""
    filament: Filament
    capstan: Capstan

    @model_validator(mode="after")
    def _consistent(self) -> CapstanScene:
        c = self.capstan
        most = 0.05 * self.filament.EA * c.filaments / math.exp(c.pulley.mu_s0 * c.wrap)
        if c.tension > most:
            expected = f"at most {units.format(float(f'{most:.3g}'), 'nN')}: a strain of 5 % at the crosshead"
            raise refusal("capstan.tension", c._shown("tension"), expected)
        return self

    @property
    def strain(self) -> float:
        """Strain of the filaments under the dead load."""
        return self.capstan.tension / self.capstan.filaments / self.filament.EA

    def column(self) -> Column:
        """What is modelled: the column, or one filament with the stiffness of all."""
        c = self.capstan
        single = c.model == "bundle"
        return Column(
            1 if single else c.filaments,
            c.nodes,
            self.filament.EA * (c.filaments if single else 1),
            c.tension,
            c.pulley_radius,
            c.wrap,
            c.free_length,
            c.speed,
            c.pulley.law(c.speed),
            c.between.law(c.speed),
        )

    def to_toml(self) -> str:
        """The scene resolved, every key written out."""
        return tomli_w.dumps(self.model_dump(exclude_none=True))


def load_capstan(source: str | Path, overrides: Sequence[str] = ()) -> CapstanScene:
    """The capstan scene of a TOML file or a shipped name, with overrides as in :func:`cgfibre.scene.load_scene`."""
    data = read_tables(source, overrides)
    if "capstan" not in data:
        raise InputError("scene", str(source), f"a scene with a table [capstan] (or cgfibre run {source})")
    return validated(CapstanScene, data)


def with_coefficients(law: StickSlipLaw, coefficients: Sequence[float]) -> StickSlipLaw:
    """A law with other (mu_s0, mu_s, mu_k)."""
    mu_s0, mu_s, mu_k = coefficients
    return replace(law, mu_s0=mu_s0, mu_s=mu_s, mu_k=mu_k)
