"""Sheets: the textures of a model, one for each material and UDIM tile, and their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stages.formats.meshes.polygons import distinct
from stages.formats.meshes.textured_models import ObjCorners
from stages.scene.cameras import Camera
from stages.texturing.given_charts import FIRST_UDIM, Chart, GivenCharts
from stages.texturing.settings import ChartSettings
from stages.texturing.texels import side_of_charts
from stages.texturing.unwrapping import ChartedMesh

MATERIAL = "albedo"  # of charts of our own
NO_PART_OF_FILES = re.compile(r"[^A-Za-z0-9_-]+")
LONGEST_LABEL = 60


@dataclass(frozen=True, eq=False)
class Sheet:
    """A texture to be made.

    Attributes
    ----------
    material : str
        Its name in the model.
    label : str
        Its name in those of its files, as ``albedo.LABEL.png``; empty where there is one texture.
    faces : ndarray, shape (f,), int64
        Of the whole mesh.
    part : ChartedMesh
        Those faces, and all vertices of the mesh.
    side : int
        Of its images, texels.
    """

    material: str
    label: str
    faces: np.ndarray
    part: ChartedMesh
    side: int

    def file(self, kind: str, suffix: str) -> str:
        """Name one of its files; UDIM tiles are where other programs look for them, before the suffix."""
        return ".".join(filter(None, [kind, self.label, suffix]))


@dataclass(frozen=True, eq=False)
class Charted:
    """The mesh that carries the textures.

    Attributes
    ----------
    mesh : ChartedMesh
    sheets : list of Sheet
    obj : ObjCorners
    given : bool
        Whether its charts are those that it was given with.
    """

    mesh: ChartedMesh
    sheets: list[Sheet]
    obj: ObjCorners
    given: bool


def sheet_of_own_charts(mesh: ChartedMesh, side: int) -> Sheet:
    """Make the one sheet of a mesh that was unwrapped here."""
    return Sheet(MATERIAL, "", np.arange(len(mesh.faces)), mesh, side)


def obj_of_own_charts(mesh: ChartedMesh) -> ObjCorners:
    """Arrange an unwrapped mesh as OBJ: along chart borders only texture coordinates are doubled."""
    count = int(mesh.original.max()) + 1
    positions, normals = np.zeros((count, 3)), np.zeros((count, 3))
    positions[mesh.original], normals[mesh.original] = mesh.vertices, mesh.normals
    corners = mesh.faces.reshape(-1).astype(np.int64)
    place = mesh.original[corners]
    return ObjCorners(
        positions,
        np.column_stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]]),
        normals,
        np.full(len(mesh.faces), 3),
        np.stack([place, corners, place], axis=1),
        np.zeros(len(mesh.faces), np.int64),
    )


def sheets_of_given_charts(given: GivenCharts, cameras: list[Camera], how: ChartSettings) -> list[Sheet]:
    """Make a sheet of each chart of a mesh that was given with them."""
    sheets = []
    for chart, (material, label) in zip(given.charts, names_of(given.charts), strict=True):
        part = replace(given.mesh, faces=given.mesh.faces[chart.faces])
        side = side_of_charts(part, cameras, how)
        sheets.append(Sheet(material, label, chart.faces, part, side))
    return sheets


def names_of(charts: Sequence[Chart]) -> list[tuple[str, str]]:
    """Name charts: in the model, and in files; no two alike, whatever letters a file system takes.

    Files are told apart by material where there are several, and by tile where there are others than the
    first.
    """
    materials = list(dict.fromkeys(chart.material for chart in charts))
    short = [NO_PART_OF_FILES.sub("_", name)[:LONGEST_LABEL] or MATERIAL for name in materials]
    in_files = dict(zip(materials, distinct(short, key=str.lower), strict=True))
    tiled = any(chart.tile != FIRST_UDIM for chart in charts)
    names = []
    for chart in charts:
        tile = [str(chart.tile)] if tiled else []
        label = [in_files[chart.material]] if len(materials) > 1 else []
        names.append((".".join([chart.material, *tile]), ".".join([*label, *tile])))
    return names
