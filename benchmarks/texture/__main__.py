"""A textured model against its views: ``python -m benchmarks.texture WORKSPACE``.

After ``unshade run CONFIG --texture --workspace WORKSPACE``. Renders the texture into the views that it was
made from and prints, per view and for all, the PSNR against the albedo of the view; the peak is the albedo
that is white in PNG files. Four figures: of all pixels as sRGB, which is what pictures show; of all, linear;
of those on no outline, sRGB; of all, weighted by the confidence of the view's own albedo, as the texture
weighs it. Then the mean step of log albedo across chart borders, across random lines as long inside charts,
and of the surface itself at these borders, without an atlas. `--maps FOLDER` writes the differences, as
pictures.
"""

from __future__ import annotations

import argparse
import functools
import operator
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.paper.tables import markdown
from benchmarks.texture.rerendering import ViewError, error_of, rendered
from benchmarks.texture.seams import Steps, steps_of
from benchmarks.texture.textured_scene import TexturedScene, read_textured_scene
from stages.formats.images.photos import write_png_srgb8
from stages.formats.meshes.triangle_meshes import Surface
from stages.texturing.rendering import TexturedSurface

SEED = 0
LARGE = 0.1  # of white: a difference that is shown as white


def main(argv: Sequence[str] | None = None) -> list[ViewError]:
    """Measure and print; returns the errors of the views."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("workspace", type=Path, help="of a run with --texture")
    parser.add_argument("--maps", type=Path, help="folder for pictures of the differences")
    given = parser.parse_args(argv)
    scene = read_textured_scene(given.workspace)
    errors = errors_of(scene, given.maps)
    rng = np.random.default_rng(SEED)
    steps = steps_of(scene.mesh, scene.albedo, scene.seen, scene.white, scene.shown, rng)
    print(table_of(errors))
    print()
    print(sentence_of(steps))
    return errors


def errors_of(scene: TexturedScene, maps: Path | None = None) -> list[ViewError]:
    """Render the views one after another and compare them."""
    surface = Surface(scene.mesh.vertices, scene.mesh.faces)
    textured, errors = TexturedSurface.of_atlas(surface, scene.mesh.uv, scene.albedo), []
    for view in scene.views():
        shown = rendered(textured, view.camera)
        compared = shown, view.albedo, view.mask
        errors.append(error_of(view.camera.name, *compared, view.confidence, scene.white))
        if maps is not None:
            both = (view.mask & shown.hit)[..., None]
            differences = np.abs(shown.albedo - view.albedo) * both / (LARGE * scene.white)
            write_png_srgb8(maps / f"{view.camera.name}.png", differences)
    return errors


def table_of(errors: Sequence[ViewError]) -> str:
    """Tabulate the errors of the views and of all their pixels."""
    rows = [
        [
            error.name,
            *(f"{of.psnr:.2f}" for of in (error.encoded, error.linear, error.inner, error.known)),
            f"{1 - error.inner.weight / max(error.encoded.weight, 1):.1%}",
            f"{error.missed / max(error.encoded.weight + error.missed, 1):.2%}",
        ]
        for error in (*errors, functools.reduce(operator.add, errors))
    ]
    head = [
        "view",
        "PSNR, dB",
        "linear",
        "without outlines",
        "by confidence",
        "on outlines",
        "beside the mesh",
    ]
    return markdown(head, rows)


def sentence_of(steps: Steps) -> str:
    """Describe the steps."""
    return (
        f"Mean step of log albedo over two texels: {steps.border:.4f} across chart borders "
        f"({steps.border_places} places), {steps.inside:.4f} across random lines inside charts "
        f"({steps.inside_places} places), {steps.surface:.4f} of the surface at these borders, without "
        "an atlas."
    )


if __name__ == "__main__":
    main()
