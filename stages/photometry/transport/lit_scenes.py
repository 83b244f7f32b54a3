"""From what the `transfer` stage has stored to what pixels see: a scene per distance of the light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from stages.formats.artefacts.transfer_file import StoredTransfer
from stages.photometry.lighting.light_estimate import SkyScene
from stages.photometry.transport.directional_transport import Eyes, sphere_of
from stages.photometry.transport.pixel_transfer import without_opposed
from stages.photometry.transport.transfer_vectors import Occlusion, Proxy


def proxy_in(stored: StoredTransfer) -> Proxy:
    """The mesh that pixels blend the vertices of."""
    seen = Occlusion(stored.blocked, stored.form_factors, stored.behind)
    return Proxy(stored.vertices, stored.normals, seen)


def sky_scenes(
    stored: StoredTransfer, blend: sp.csr_array, normals: np.ndarray, eyes: Eyes | None = None
) -> tuple[list[SkyScene], int]:
    """Scenes in the order of the stored radii, and how many pixels see the back of the mesh.

    Parameters
    ----------
    stored : StoredTransfer
    blend : csr_array, shape (N, P)
    normals : ndarray, shape (N, 3)
        Of the pixels.
    eyes : Eyes or None
        Of the proxy's vertices, for those who look in other directions than are stored.
    """
    blend, opposed = without_opposed(normals, blend, stored.normals)
    proxy, scenes = proxy_in(stored), []
    for radius, visible in zip(stored.radii.tolist(), stored.visible, strict=True):
        sphere = sphere_of(stored.centre, radius)
        scene = SkyScene.of(normals, blend, proxy, visible, int(stored.directions), sphere)
        scenes.append(replace(scene, eyes=eyes))
    return scenes, opposed
