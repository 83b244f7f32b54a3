"""The cache key of a result: a digest of everything it depends on, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from pipeline.cache.digest import digest_files, digest_value
from pipeline.settings import settings_that_matter
from pipeline.stage import S, Stage

FileDigests = Mapping[str, str]


@dataclass(frozen=True)
class Ingredients:
    """Everything that one result depends on: its digest is the key; a change in it is the reason for a run.

    Attributes
    ----------
    stage, version : str, int
    settings : dict
        The settings that change the result, by public name.
    inputs : dict of str to dict
        Per input, the digest of each file by relative path.
    tools, machine : dict of str to str
    """

    stage: str
    version: int
    settings: Mapping[str, Any]
    inputs: Mapping[str, FileDigests]
    tools: Mapping[str, str]
    machine: Mapping[str, str]

    @property
    def key(self) -> str:
        """Digest of all ingredients."""
        return digest_value(
            {
                "stage": self.stage,
                "version": self.version,
                "settings": self.settings,
                "inputs": {name: digest_files(digests) for name, digests in self.inputs.items()},
                "tools": self.tools,
                "machine": self.machine,
            }
        )


def ingredients(stage: Stage[S], settings: S, inputs: Mapping[str, FileDigests]) -> Ingredients:
    """Collect the ingredients of a stage's result from the present settings, inputs, tools and machine."""
    return Ingredients(
        stage=stage.name,
        version=stage.version,
        settings=settings_that_matter(settings, stage.ignores),
        inputs=dict(inputs),
        tools={tool: tool_version(tool) for tool in stage.tools},
        machine=dict(stage.machine(settings)),
    )


def tool_version(distribution: str) -> str:
    """Look up the installed version of a distribution; ``"absent"`` if there is none."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "absent"
