"""All that the page tells, from the records of the stages and the content that the stage `report` made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from pipeline.cache.record import Record
from pipeline.request import Result
from stages.reporting.parts import read_content

REPORT, CONTENT = "report", "report_content"


@dataclass(frozen=True)
class Told:
    """Records and content.

    Attributes
    ----------
    title : str
        Name of the workspace.
    folder : Path
        Of the content's files.
    content : dict
        As the stage `report` wrote it.
    records : mapping of str to Record
        Of the stages that have results, in their order.
    defaults : mapping of str to mapping of str to value
        Defaults of the settings, by stage.
    version : str
        Of unshade.
    """

    title: str
    folder: Path
    content: dict[str, Any]
    records: Mapping[str, Record]
    defaults: Mapping[str, Mapping[str, Any]]
    version: str

    @classmethod
    def of(
        cls, results: Mapping[str, Result], defaults: Mapping[str, Mapping[str, Any]], version: str
    ) -> Told:
        """Read the content of the results of all stages, that of `report` among them."""
        folder = results[REPORT].folder / CONTENT
        records = {name: result.record for name, result in results.items()}
        title = results[REPORT].folder.parents[2].resolve().name
        return cls(title, folder, read_content(folder), records, defaults, version)

    @property
    def views(self) -> list[dict[str, Any]]:
        """Descriptions of the views."""
        return self.content["views"]

    @property
    def links(self) -> dict[int, dict[int, int]]:
        """Numbers of links, by view and by the other view."""
        found: dict[int, dict[int, int]] = {number: {} for number in range(len(self.views))}
        for pair in self.content["graph"]:
            found[pair["i"]][pair["j"]] = found[pair["j"]][pair["i"]] = pair["links"]
        return found

    @property
    def left_out(self) -> list[str]:
        """Names of photos that were given, and are no views."""
        names = {view["name"] for view in self.views}
        for record in self.records.values():
            if photos := record.inputs.get("images"):
                return sorted(
                    name for name in photos if str(PurePosixPath(name).with_suffix("")) not in names
                )
        return []

    def best_view(self) -> int:
        """Choose the view that shows most of the surface, and shows it best."""

        def worth(view: dict[str, Any]) -> float:
            return view["coverage"] * (1 if view["confident"] is None else view["confident"])

        return max(range(len(self.views)), key=lambda number: worth(self.views[number]))
