"""Ray casting of the mesh in each view (n^i, Ω^i, π⁻¹ in the paper): depth, normals, masks, triangles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Settings, Stage, UserError, group, setting
from pipeline.settings import near
from stages.scene.distributions import OPEN3D, PICTURES, PYCOLMAP

if TYPE_CHECKING:
    import numpy as np

    from stages.geometry.rays import Seen
    from stages.scene.cameras import Camera


class FitCheckSettings(Settings):
    """Settings of the comparison of the mesh with the sparse points: of a warning, not of the maps."""

    largest_gap: float = setting(
        0.05,
        "A sparse point farther before or behind the mesh is off it: farther than stereo or a scan ever is.",
        unit="diagonals of the mesh's box",
        gt=0,
        le=1,
    )
    off_share: float = setting(
        0.5,
        "The mesh seems to be in another frame if more than this share of the points is off it.",
        ge=0,
        le=1,
    )
    fewest_sightings: int = setting(
        50, "Sightings of sparse points below which nothing is said about it.", unit="sightings", ge=1
    )


class WindingCheckSettings(Settings):
    """Settings of the check of which side of its faces the mesh shows: of a warning, not of the maps."""

    behind_share: float = setting(
        0.5,
        "The mesh seems to be inside out if more than this share of what the views see of it are backs of "
        "faces: of a closed surface none is, of an open one, as a leaf, half at most where views are around.",
        ge=0,
        le=1,
        changes_result=False,
    )


class RaycastSettings(Settings):
    """Settings of the `raycast` stage."""

    views: tuple[str, ...] = setting(
        (),
        'The views to decompose, by name without extension, as in ["001", "b*"]; * and ? allowed, and ! '
        "before those that are left out. Empty: all. The other views still serve the geometry.",
    )
    reduce: int = setting(
        1,
        "The views are decomposed at the working size divided by this. The paper's solver is slow: "
        "2 or 3 saves most of its time.",
        ge=1,
        le=16,
    )
    outline_px: float = setting(
        6.0,
        "Of the mesh, what a view shows as even background (`mvs`) is not used in that view this near to the "
        "mesh's outline: stereo and Poisson go on beyond outlines by up to so much, as into the sky around a "
        "chimney. 0: all is used. Farther inside it may be a plain wall.",
        unit="px at working size",
        ge=0,
        le=100,
    )
    fit_check: FitCheckSettings = group(
        FitCheckSettings, "Whether the mesh lies where the sparse points are, else a warning."
    )
    winding_check: WindingCheckSettings = group(
        WindingCheckSettings, "Whether the mesh shows the views the front of its faces, else a warning."
    )


def chosen_views(names: list[str], patterns: tuple[str, ...]) -> list[str]:
    """Choose the names that fit a pattern, and none that fits one after a "!", in their own order.

    Without patterns, or with such alone, all others are chosen.

    Raises
    ------
    UserError
        A pattern fits no view, or none is left.
    """
    left_out = tuple(p for p in patterns if p.startswith("!") and p not in names)
    wanted = tuple(p for p in patterns if p not in left_out)
    for pattern in (*wanted, *(p[1:] for p in left_out)):
        if not any(_fits(name, pattern) for name in names):
            raise UserError(f"raycast.views: no view is called {pattern!r}; {near(pattern, names)}")
    chosen = [name for name in names if not wanted or any(_fits(name, p) for p in wanted)]
    chosen = [name for name in chosen if not any(_fits(name, p[1:]) for p in left_out)]
    if not chosen:
        raise UserError(
            f"raycast.views is {list(patterns)}, which leaves none of the {len(names)} views; expected at "
            "least one. Take a pattern out of it."
        )
    return chosen


def _fits(name: str, pattern: str) -> bool:
    """A name fits itself as well, whatever brackets are in it."""
    return name == pattern or fnmatchcase(name, pattern)


def run(job: Job[RaycastSettings]) -> None:
    """Open mesh and cameras, cast each view's rays, save the maps. Memory: one view and the mesh."""
    import numpy as np

    from stages.formats.artefacts.camera_file import write_cameras
    from stages.formats.images.masks import kept_at
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.geometry.outlines.mesh_fit import gaps_at_points
    from stages.geometry.rays import RayCaster
    from stages.stereo.workspace import open_workspace

    settings = job.settings
    workspace = open_workspace(job.inputs["workspace"])
    cameras, sparse = {camera.name: camera for camera in workspace.cameras}, workspace.points
    observed = dict(zip(cameras, sparse.seen, strict=True))
    mesh = read_mesh(job.inputs["mesh"])
    caster = RayCaster(mesh)
    views, coverage, gaps, behind, beyond = [], {}, [], np.zeros(2, np.int64), 0
    with job.progress("rays", len(cameras)) as step:
        for name in chosen_views(list(cameras), settings.views):
            camera = cameras[name]
            camera = camera.scaled(
                *(max(1, side // settings.reduce) for side in (camera.width, camera.height))
            )
            seen = caster.see(camera, job.threads)
            kept = seen.mask & kept_at(job.inputs["kept"] / f"{name}.png", camera.shape)
            used = kept & ~_beyond_outline(job, camera, seen.mask)
            beyond += int(kept.sum() - used.sum())
            coverage[name] = round(float(used.mean()), 4)
            behind += (seen.behind & used).sum(), used.sum()
            gaps.append(gaps_at_points(camera, seen.depth, sparse.x_in_world[observed[name]]))
            step()
            if not used.any():
                job.warn(
                    f"View {name} sees nothing of the mesh inside its mask; it is left out. Check its mask, "
                    "and whether the surface is complete there."
                )
                continue
            views.append(camera)
            _save_maps(job, name, seen, used)
    if not views:
        raise UserError(
            "No view sees the mesh; expected cameras and mesh in one frame. Check that --mesh and --colmap "
            "belong together, and that the masks are white where the object is."
        )
    sightings = sum(int(observed[name].sum()) for name in coverage)
    _tell_fit(job, np.concatenate(gaps), sightings, mesh.diagonal)
    _tell_winding(job, float(behind[0] / behind[1]))
    write_cameras(job.outputs["cameras"], views)
    mean_coverage = round(float(np.mean(list(coverage.values()))), 4)
    job.note(beyond_outlines=beyond, coverage=coverage, mean_coverage=mean_coverage)


def _save_maps(job: Job[RaycastSettings], name: str, seen: Seen, used: np.ndarray) -> None:
    """Save what a view sees of the mesh, and which of its pixels are used, (h, w), bool."""
    import numpy as np

    from stages.formats.images.exr import write_exr
    from stages.formats.images.photos import write_mask

    write_exr(job.outputs["depth"] / f"{name}.exr", seen.depth)
    write_exr(job.outputs["normal"] / f"{name}.exr", seen.normals, is_colour=False)
    write_mask(job.outputs["mask"] / f"{name}.png", used)
    triangles = job.outputs["triangles"] / f"{name}.npz"
    triangles.parent.mkdir(parents=True, exist_ok=True)
    np.savez(triangles, triangles=seen.triangles, barycentric=seen.barycentric)


def _beyond_outline(job: Job[RaycastSettings], camera: Camera, mask: np.ndarray) -> np.ndarray:
    """Select pixels of the mesh, (h, w), that the photo shows as background; none unless stereo said."""
    import numpy as np

    from stages.formats.images.masks import background_at
    from stages.geometry.outlines.mesh_fit import beyond_outline

    if "background" not in job.inputs:
        return np.zeros_like(mask)
    background = background_at(job.inputs["background"] / f"{camera.name}.png", camera.shape)
    return beyond_outline(mask, background, job.settings.outline_px / job.settings.reduce)


def _tell_fit(job: Job[RaycastSettings], gaps: np.ndarray, sightings: int, size: float) -> None:
    """Warn where the mesh lies elsewhere than the surface that the photos show."""
    check = job.settings.fit_check
    apart = int((gaps > check.largest_gap * size).sum())
    if sightings < check.fewest_sightings or (apart <= check.off_share * len(gaps) and len(gaps)):
        return
    where = (
        f"{apart} of the {len(gaps)} on it lie more than {check.largest_gap:.0%} of its size before or "
        "behind it"
        if len(gaps)
        else "none falls on it"
    )
    job.warn(
        f"The mesh seems not to be in the cameras' frame: of {sightings} sightings of sparse points {where}; "
        "expected most on its surface. Check its axes (y up or z up), scale and origin."
    )


def _tell_winding(job: Job[RaycastSettings], share: float) -> None:
    """Warn where the views see the backs of the mesh's faces; `share` of the pixels that see it."""
    job.note(seen_from_behind=round(share, 4))
    if share > job.settings.winding_check.behind_share:
        job.warn(
            f"The mesh seems to be inside out: {share:.0%} of what the views see of it are backs of faces; "
            "expected fronts. Light and visibility are those of the front, and the albedo will be wrong. "
            "Turn its faces over (in Blender: Mesh > Normals > Flip), and give it again."
        )


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"the surface covers {facts['mean_coverage']:.0%} of {len(facts['coverage'])} views"


RAYCAST = Stage(
    name="raycast",
    version=4,
    about="Depth, normals, masks and triangle maps of the mesh in each view.",
    settings=RaycastSettings,
    takes=("mesh", "workspace", "kept", "background"),
    gives=(
        Artefact("depth", "z-depth per view, EXR, model units, 0 = nothing", output="depth"),
        Artefact("normal", "unit normals per view, EXR, world axes", output="normal"),
        Artefact("mask", "Ω per view, PNG, white = used", output="mask"),
        Artefact("triangles", "face and barycentric coordinates per pixel, npz"),
        Artefact(
            "cameras", "the cameras of the decomposed views", file="cameras.json", output="cameras.json"
        ),
    ),
    run=run,
    tools=("numpy", "numba", *PYCOLMAP, *OPEN3D, *PICTURES),
    saves_memory="set raycast.reduce=2, or give a mesh of fewer faces",
    found=in_words,
)

# Without stereo nobody says where background is.
RAYCAST_OF_GIVEN_SURFACE = replace(RAYCAST, takes=("mesh", "workspace", "kept"), ignores=("outline_px",))
