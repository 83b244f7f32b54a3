"""Normals of smoothed meshes, refined: the angles are those of the normals, and settings are read."""

import numpy as np
import pytest

from benchmarks.refined_normals import SCENES, angles_deg, main, photograph, settings_of


def test_the_exact_mesh_has_the_true_normals_and_one_that_leans_has_its_angle():
    scene = photograph(SCENES["bust-wood"], 60, None)
    assert scene.masks[scene.cameras[0].name].sum() > 300
    np.testing.assert_allclose(angles_deg(scene, scene.mesh), 0, atol=0.1)
    turned = {name: normals @ _rotation(5.0).T for name, normals in scene.normals.items()}
    scene.normals.update(turned)
    median, most, _ = angles_deg(scene, scene.mesh)
    assert 2 < median < most <= 5.01


def test_settings_of_the_stage_are_read():
    found = settings_of(["neighbours=3", "roughness.tail=1", "scales=[2, 1]"])
    assert (found.neighbours, found.roughness.tail, found.scales) == (3, 1.0, (2, 1))


@pytest.mark.slow
def test_relief_is_found_in_the_scene_of_the_table(capsys):
    main(["--scenes", "relief-masonry", "--smoothing", "10", "--size", "240"])
    *_, change = capsys.readouterr().out.strip().splitlines()[0].split(" | ")
    assert int(change.split()[0]) < -25


def _rotation(degrees: float) -> np.ndarray:
    cosine, sine = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
