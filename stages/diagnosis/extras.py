"""Extras of the distribution: what each is for, and whether it is installed."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from pipeline.process.installation import install_extra


@dataclass(frozen=True)
class Extra:
    """An optional part of the installation.

    Attributes
    ----------
    name : str
    gives : str
        What it makes possible.
    modules : dict of str to tuple of str
        Distributions by module, as `libraries.NEEDED`.
    """

    name: str
    gives: str
    modules: dict[str, tuple[str, ...]]

    @property
    def is_installed(self) -> bool:
        """Whether all its modules are there, loadable or not."""
        return all(find_spec(module) is not None for module in self.modules)

    @property
    def command(self) -> str:
        """The command that installs it."""
        return install_extra(self.name)


EXTRAS = (  # those for users: not of tests and benchmarks
    Extra(
        "cluster",
        "--workers and --scheduler",
        {"distributed": ("distributed",), "cryptography": ("cryptography",)},
    ),
    Extra("heic", "photos in HEIC and HEIF", {"pi_heif": ("pi-heif",)}),
    Extra("raw", "camera raw: DNG, CR3, NEF, ARW and the like", {"rawpy": ("rawpy",)}),
    Extra(
        "synthetic",
        "rendered scenes of known truth",
        {"mitsuba": ("mitsuba",), "skimage": ("scikit-image",)},
    ),
)
