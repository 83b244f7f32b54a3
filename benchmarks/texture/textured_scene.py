"""A textured model in a workspace, and the maps that it was made from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh

from pipeline import UserError
from pipeline.cache.record import Record
from pipeline.cache.store import Store
from stages import ALL_STAGES
from stages.formats.artefacts.camera_file import read_cameras
from stages.formats.artefacts.png_scale import png_whites
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask
from stages.scene.cameras import Camera
from stages.scene.upright import gltf_from_world
from stages.texture import views_of
from stages.texturing.gathering import gathered, typical_footprint
from stages.texturing.settings import TextureSettings
from stages.texturing.unwrapping import ChartedMesh


@dataclass(frozen=True, eq=False)
class ViewAlbedo:
    """The albedo of a view that the texture was made from.

    Attributes
    ----------
    camera : Camera
        At the size of the albedo.
    albedo : ndarray, shape (h, w, 3), float32
        Linear.
    mask : ndarray, shape (h, w), bool
    confidence : ndarray, shape (h, w), float32
        Of the albedo, 0 to 1; of the mask, where it is not known.
    """

    camera: Camera
    albedo: np.ndarray
    mask: np.ndarray
    confidence: np.ndarray


@dataclass(frozen=True, eq=False)
class TexturedScene:
    """A textured model and its views.

    Attributes
    ----------
    mesh : ChartedMesh
        As the GLB holds it, in world axes.
    albedo : ndarray, shape (s, s, 3), float32
        The atlas, linear.
    seen : ndarray, shape (s, s), bool
        Texels that some view shows.
    white : float
        Albedo that is white in PNG files.
    cameras : list of Camera
        At working size.
    made_from : dict of str to Path
        What the texture was made from, by the names of artefacts.
    settings : TextureSettings
        With which it was made.
    """

    mesh: ChartedMesh
    albedo: np.ndarray
    seen: np.ndarray
    white: float
    cameras: list[Camera]
    made_from: dict[str, Path]
    settings: TextureSettings

    def views(self) -> Iterator[ViewAlbedo]:
        """Open the views one after another."""
        finest = self.made_from["albedo_full" if "albedo_full" in self.made_from else "albedo"]
        for camera in self.cameras:
            albedo = read_exr(finest / f"{camera.name}.exr")
            mask = read_mask(self.made_from["mask"] / f"{camera.name}.png")
            known = mask.astype(np.float32)
            if "confidence" in self.made_from:
                known = read_exr(self.made_from["confidence"] / f"{camera.name}.exr")
            size = albedo.shape[1::-1]
            if mask.shape != albedo.shape[:2]:  # at the photos' resolution: albedo where there is surface
                mask, known = albedo.any(axis=2), cv2.resize(known, size, interpolation=cv2.INTER_LINEAR)
            yield ViewAlbedo(camera.scaled(*size), albedo, mask, known)

    def shown(self, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Average what the views show of points of the surface, as the texture does, without an atlas.

        Parameters
        ----------
        points, normals : ndarray, shape (m, 3), float32
            World axes, points from the mean of the mesh's vertices.

        Returns
        -------
        tuple of ndarray, shape (m, 3), float32, and ndarray, shape (m,), bool
            Albedo, and whether a view shows the point.
        """
        found = gathered(
            points,
            normals,
            self.mesh.vertices.mean(axis=0),
            typical_footprint(self.mesh.vertices, self.cameras),
            lambda: views_of(self.made_from, self.cameras, self.settings),
            self.settings.gathering,
        )
        return found.albedo, found.weight > 0


def read_textured_scene(workspace: Path) -> TexturedScene:
    """Open the newest textured model of a workspace, and exactly the results that it was made from.

    Raises
    ------
    UserError
        There is none, or what it was made from is no longer there.
    """
    store = Store(workspace)
    record = store.latest("texture")
    if record is None:
        raise UserError(
            f"{workspace} holds no textured model; run `unshade run CONFIG --texture` with it first."
        )
    made_from = _inputs_of(store, record)
    folder = store.entry("texture", record.key) / "textured_model"
    cameras = read_cameras(made_from["cameras"])
    settings = settings_in(record)
    turned = gltf_from_world(cameras, settings.upright_within_deg)
    return TexturedScene(
        charted_mesh_of(folder / "model.glb", turned),
        read_exr(folder / "albedo.exr"),
        read_exr(folder / "confidence.exr") > 0,
        png_whites(made_from["scales"])["albedo"],
        cameras,
        made_from,
        settings,
    )


def charted_mesh_of(glb: Path, gltf_from_world: np.ndarray) -> ChartedMesh:
    """Read the mesh of a GLB with trimesh, turned back into world axes; equal places are one vertex."""
    model = trimesh.load(glb, force="mesh", process=False)
    vertices = np.asarray(model.vertices, np.float64)
    _, original = np.unique(vertices, axis=0, return_inverse=True)
    return ChartedMesh(
        vertices @ gltf_from_world,
        np.asarray(model.vertex_normals, np.float64) @ gltf_from_world,
        np.asarray(model.faces, np.int32),
        np.column_stack([model.visual.uv[:, 0], 1 - model.visual.uv[:, 1]]),  # trimesh's v is upwards
        original.ravel(),
    )


def settings_in(record: Record) -> TextureSettings:
    """Read the settings of a record, which names those of phases with dots."""
    nested: dict[str, Any] = {}
    for name, value in record.settings.items():
        *phases, own = name.split(".")
        place = nested
        for phase in phases:
            place = place.setdefault(phase, {})
        place[own] = value
    return TextureSettings.model_validate(nested)


def _inputs_of(store: Store, record: Record) -> dict[str, Path]:
    """Find the results whose files have the digests that a record's inputs have."""
    found: dict[str, Path] = {}
    for stage in ALL_STAGES:
        for artefact in stage.gives:
            for made in store.records(stage.name):
                if record.inputs.get(artefact.name) == made.outputs.get(artefact.name, ""):
                    found[artefact.name] = store.entry(stage.name, made.key) / artefact.path
    if lost := sorted(set(record.inputs) - set(found)):
        raise UserError(f"{', '.join(lost)} of the textured model is no longer there; run it again.")
    return found
