"""Depth maps that a dense workspace of COLMAP holds already: checked, and fused by COLMAP."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap

from pipeline import UserError
from stages.formats.colmap.depth_maps import check_map
from stages.formats.colmap.model import centre_on_cameras, count_from_first_centre, read_model, registered
from stages.formats.meshes.point_clouds import read_cloud

MAPS = ("depth_maps", "normal_maps")
KIND = "geometric"  # maps that other views have confirmed; `photometric` ones have not been filtered


def views_with_maps(folder: Path) -> tuple[list[str], list[str]]:
    """Sort the images of a dense workspace by name into those with both maps, and those without.

    Raises
    ------
    UserError
        No image has both maps, or a map is damaged.
    """
    names = sorted(image.name for image in registered(read_model(folder / "sparse")))
    whole: list[str] = []
    lacking: list[str] = []
    for name in names:
        paths = [folder / "stereo" / kind / f"{name}.{KIND}.bin" for kind in MAPS]
        there = all(path.is_file() for path in paths)
        (whole if there else lacking).append(name)
        for path in paths if there else ():
            check_map(path)  # COLMAP would end the whole process
    if not whole:
        raise UserError(
            f"{folder} holds no image with a depth map and a normal map (stereo/depth_maps/NAME.{KIND}.bin); "
            "expected a workspace after COLMAP's patch_match_stereo with geometric consistency. Run that, or "
            "leave out --points."
        )
    return whole, lacking


def fused_points(
    folder: Path, names: list[str], scratch: Path, fewest_views: int, cache_gb: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fuse the maps of these images: positions and normals, (n, 3), and colours, as `read_cloud`.

    Parameters
    ----------
    folder : Path
        Dense workspace: ``images/``, ``sparse/`` and ``stereo/``.
    names : list of str
        Images with both maps.
    scratch : Path
        Takes a workspace of links.
    fewest_views : int
        Views that agree on a point, or all of them where there are fewer.
    cache_gb : float
        Maps in memory, GB.

    Notes
    -----
    In one thread: several would find other points in every run. The maps are fused where the photos show
    them: see `count_from_first_centre`.
    """
    linked = scratch / "workspace"
    (linked / "stereo").mkdir(parents=True)
    (linked / "images").symlink_to((folder / "images").resolve())
    for kind in MAPS:
        (linked / "stereo" / kind).symlink_to((folder / "stereo" / kind).resolve())
    (linked / "stereo/fusion.cfg").write_text("".join(f"{name}\n" for name in names), encoding="utf-8")
    model = read_model(folder / "sparse")
    count_from_first_centre(model)
    (linked / "sparse").mkdir()
    origin = centre_on_cameras(model)
    model.write(linked / "sparse")
    options = pycolmap.StereoFusionOptions()
    options.min_num_pixels, options.num_threads = min(fewest_views, len(names)), 1
    options.use_cache, options.cache_size = True, cache_gb
    fused = scratch / "fused.ply"
    pycolmap.stereo_fusion(fused, linked, input_type=KIND, options=options, output_type="PLY")
    x_from_origin, normals, colours = read_cloud(fused)
    return x_from_origin + origin, normals, colours
