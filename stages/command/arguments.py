"""Arguments of the command line as types, from which tyro builds the parser and the help."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg

from pipeline import UserError


def optional(metavar: str, name: str | None = None) -> Any:
    """Declare an option that need not be given, as the help shows it."""
    return arg(metavar=metavar, name=name, help_behavior_hint="")


Folder = Annotated[Path | None, optional("DIR")]
File = Annotated[Path | None, optional("FILE")]
StageName = Annotated[str | None, optional("STAGE")]


@dataclass(frozen=True)
class Given:
    """Inputs, workspace and settings, common to most commands.

    Attributes
    ----------
    config
        YAML configuration; without it the defaults suit a folder of photos.
    workspace
        Folder for the cache and the output; by default the configuration's, else `workspaces/NAME` in the
        current folder: named like the photos' folder, or the one above it where that is `photos` or the like.
    images
        Folder of photos.
    colmap
        Folder with a COLMAP model: its cameras are used instead of running structure from motion.
    cameras
        Cameras of another program, used likewise: transforms.json (NeRF, nerfstudio), bundle.out (Bundler),
        cameras.sfm (Meshroom), XML (Metashape), or matrices, a line or a file for each photo.
    points
        Fused points with normals (PLY, as COLMAP's fused.ply) in the frame of these cameras, used instead of
        dense stereo; or a dense workspace of COLMAP, whose depth maps are fused.
    mesh
        Mesh in the frame of these cameras, used instead of dense stereo and reconstruction.
    masks
        Folder of masks named like the photos, white = keep.
    object
        Mesh to render instead of the bust, where the configuration asks for a rendered scene.
    environment
        Environment map (EXR, HDR) that lights a rendered scene.
    known_light
        Environment map (EXR, HDR), measured where the photos were taken; twice as wide as high, its zenith in
        the first row. Instead of the light, only its rotation about the vertical is estimated.
    white
        A grey or white card in a photo, as in `--white 812,440,60,60@IMG_0012.jpg=0.18`: left, top, width and
        height in pixels of the photo as it is shown, and its reflectance, or three for red, green and blue;
        repeatable. Albedo, shading and light come on its scale.
    chart
        A colour chart of 24 patches in a photo: X1,Y1,X2,Y2,X3,Y3,X4,Y4@NAME, the outer corners of the
        patches dark skin, bluish green, black and white; repeatable.
    colour_space
        Colour space of the EXRs in output/: `srgb-linear`, the default, or `acescg`.
    assignments
        A setting, as in `--set decomposition.edges.coarse_lambda=5`; repeatable.
    threads
        Processor threads; by default all. Never changes a result.
    memory
        Memory that a stage may take, and each worker, as in `--memory 6GB`; by default 70 % of the machine's.
        Where need be, light and albedo of many views are found in smaller clusters and photos are reduced
        further, which is part of the settings (lighting.pixels, decomposition.clusters.pixels,
        mesh.most_cells, transfer.most_vertices, undistort.auto.view_megapixels).
    workers
        Run the tasks of stages (views, pairs, clusters of pixels) in so many processes of this machine. Needs
        Dask. Never changes a result.
    scheduler
        Run them on the workers of a Dask scheduler, as in `--scheduler tcp://HOST:8786`. All machines must
        share the workspace and the photos under the same paths.
    json
        Answer in JSON on the output stream.
    """

    config: Annotated[Positional[Path | None], optional("[CONFIG]")] = None
    workspace: Folder = None
    images: Folder = None
    colmap: Folder = None
    cameras: File = None
    points: File = None
    mesh: File = None
    masks: Folder = None
    object: File = None
    environment: File = None
    known_light: File = None
    white: Annotated[UseAppendAction[tuple[str, ...]], optional("X,Y,W,H@NAME=VALUE")] = ()
    chart: Annotated[UseAppendAction[tuple[str, ...]], optional("X1,Y1,…,X4,Y4@NAME")] = ()
    colour_space: Annotated[Literal["srgb-linear", "acescg"] | None, optional("SPACE")] = None
    assignments: Annotated[UseAppendAction[tuple[str, ...]], optional("STAGE.SETTING=VALUE", "set")] = ()
    threads: Annotated[int | None, optional("N")] = None
    memory: Annotated[str | None, optional("SIZE")] = None
    workers: Annotated[int | None, optional("N")] = None
    scheduler: Annotated[str | None, optional("ADDRESS")] = None
    json: bool = False


@dataclass(frozen=True)
class Run(Given):
    """Run every stage whose result is not up to date.

    Attributes
    ----------
    only
        Run this stage alone; the ones before it must be up to date.
    first
        Run this stage and those after it; the ones before it must be up to date.
    last
        Stop after this stage.
    force
        Run the selected stages even where they are up to date.
    full_resolution
        Also write the albedo at the photos' own resolution, into output/albedo_full.
    texture
        Also write a textured model, GLB and OBJ, into output/model; with the albedo at the photos' own
        resolution.
    delit_photos
        Also write the photos without their light, under their own names and of their own size, distortion
        included, into output/delit: for programs that have the photos already.
    """

    only: StageName = None
    first: Annotated[str | None, optional("STAGE", "from")] = None
    last: Annotated[str | None, optional("STAGE", "to")] = None
    force: bool = False
    full_resolution: bool = False
    texture: bool = False
    delit_photos: bool = False


@dataclass(frozen=True)
class Plan(Run):
    """Print what `run` would do, stage by stage, and why. Takes its arguments, runs nothing."""


@dataclass(frozen=True)
class Relight(Given):
    """Show the views under another light, from their albedo; stages that it needs are run where necessary.

    Attributes
    ----------
    light
        Environment map (EXR, HDR), twice as wide as high, its zenith in the first row.
    sun
        Azimuth and elevation, in degrees, of the sun in a clear sky, instead of an environment map; azimuth 0
        is the middle of such a map, and grows counter-clockwise seen from above.
    turntable
        Also show the textured model under that light from so many sides, all around, into output/turntable.
    """

    light: File = None
    sun: Annotated[str | None, optional("AZIMUTH,ELEVATION")] = None
    turntable: Annotated[int | None, optional("N")] = None


@dataclass(frozen=True)
class Report(Given):
    """Write output/report.html anew from the results that are there; takes the arguments of `run`."""


@dataclass(frozen=True)
class Status(Given):
    """List the results in the workspace and their cost."""


@dataclass(frozen=True)
class Show(Given):
    """Print the record of a stage's newest result.

    Attributes
    ----------
    stage
        Which stage.
    key
        Beginning of a result's key, for a result other than the newest.
    """

    stage: str = "decomposition"
    key: Annotated[str | None, optional("KEY")] = None


@dataclass(frozen=True)
class Diff(Given):
    """Print the differences between two results of a stage.

    Attributes
    ----------
    stage
        Which stage.
    keys
        Beginnings of two keys; by default the newest result and the one before.
    """

    stage: str = "decomposition"
    keys: Annotated[tuple[str, str] | None, optional("KEY KEY")] = None


@dataclass(frozen=True)
class Clean(Given):
    """Delete the results that the newest run of their stage did not use. Those of other settings, too.

    Attributes
    ----------
    everything
        Delete the current ones too; `output/` stays.
    """

    everything: bool = False


@dataclass(frozen=True)
class Evaluate:
    """Evaluate albedo maps against truth, photos, or another light.

    With TRUTH: variance, si-RMSE, LMSE, PSNR-H, leak, agreement between views, detail per octave.

    With --photos: detail per octave, where the shading has little energy.

    With --other-light: difference between the albedos of one scene under two lights.

    Attributes
    ----------
    prediction
        Folder of albedo maps (EXR: linear; PNG, TIFF, JPEG: sRGB), or an output folder of unshade.
    truth
        Folder of true albedo maps of the same names, or one with albedo/, mask/, parts/, shading/.
    masks
        Folder of masks, white = evaluate; by default the prediction's mask/. The truth's masks always apply.
    correspondences
        Folder of correspondences, for the agreement between views; with TRUTH.
    photos
        Folder of the photos behind the albedo (EXR: linear), of its size or larger: compares their detail.
    shading
        Folder of shading maps, for the detail against the photos; by default the prediction's shading/.
    other_light
        Albedo maps of the same views of the same scene under another light: compares the two.
    other_photos
        Folder of the photos under the other light: gives the remaining share of the photos' difference.
    json
        Answer in JSON on the output stream.
    """

    prediction: Annotated[Positional[Path], arg(metavar="PREDICTION")]
    truth: Annotated[Positional[Path | None], optional("[TRUTH]")] = None
    masks: Folder = None
    correspondences: Folder = None
    photos: Folder = None
    shading: Folder = None
    other_light: Folder = None
    other_photos: Folder = None
    json: bool = False


@dataclass(frozen=True)
class Compare:
    """Write a page with two results of the same photos side by side.

    Attributes
    ----------
    a
        Workspace, or configuration: of that, the results that a run would reuse.
    b
        The other one.
    set_a
        A setting of configuration A, as in `--set-a decomposition.mode=paper`; repeatable.
    set_b
        A setting of configuration B; repeatable.
    output
        The page; by default `comparison.html` in the current folder.
    json
        Answer in JSON on the output stream.
    """

    a: Annotated[Positional[Path], arg(metavar="A")]
    b: Annotated[Positional[Path], arg(metavar="B")]
    set_a: Annotated[UseAppendAction[tuple[str, ...]], optional("STAGE.SETTING=VALUE")] = ()
    set_b: Annotated[UseAppendAction[tuple[str, ...]], optional("STAGE.SETTING=VALUE")] = ()
    output: File = None
    json: bool = False


@dataclass(frozen=True)
class Doctor:
    """Say what this machine has, and what a set of photos would take.

    Attributes
    ----------
    folder
        Folder of the photos.
    photos
        Number of photos, in place of a folder; with --megapixels.
    megapixels
        Size of such a photo.
    workspace
        Folder for the cache and the output, whose disk is looked at; by default `workspaces`.
    assignments
        A setting, as in `--set undistort.auto.processor_minutes=120`; repeatable.
    threads
        Processor threads; by default all.
    memory
        Memory that a stage may take, as in `--memory 6GB`; by default 70 % of the machine's.
    json
        Answer in JSON on the output stream.
    """

    folder: Annotated[Positional[Path | None], optional("[PHOTOS]")] = None
    photos: Annotated[int | None, optional("N")] = None
    megapixels: Annotated[float | None, optional("M")] = None
    workspace: Folder = None
    assignments: Annotated[UseAppendAction[tuple[str, ...]], optional("STAGE.SETTING=VALUE", "set")] = ()
    threads: Annotated[int | None, optional("N")] = None
    memory: Annotated[str | None, optional("SIZE")] = None
    json: bool = False


Command = Run | Plan | Relight | Report | Status | Show | Diff | Clean | Evaluate | Compare | Doctor


def refuse_empty(words: Sequence[str]) -> None:
    """Refuse empty words, and options with nothing after their equals sign.

    Raises
    ------
    UserError
        There is one: as a path, it would be the current folder.
    """
    for place, word in enumerate(words):
        if not word or (word.startswith("--") and word.endswith("=")):
            where = f" after {words[place - 1]}" if not word and place else f" after {word}" if word else ""
            raise UserError(
                f"An empty word was given{where}; expected a path, a name or a value. Perhaps a shell "
                "variable is not set."
            )
