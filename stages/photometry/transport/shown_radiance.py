"""Interreflection from the radiance that photos in one light show, and from what follows for the rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stages.photometry.transport.directional_transport import DirectionalTransport
from stages.photometry.transport.pixel_transfer import WHITEST, nearest_of
from stages.photometry.transport.transfer_vectors import Proxy
from stages.solvers.kernels.sparse_rows import product

NO_LIGHT = 1e-6  # of the scaled image's unit: surface with less light has no albedo


@dataclass(frozen=True, eq=False)
class ShownRadiance:
    """Radiance of the proxy's vertices as photos show it, with all its bounces.

    Attributes
    ----------
    radiance : ndarray, shape (P, 3), float32
        In the unit of the images; of a vertex that no pixel shows, the nearest shown one's.
    nearest : ndarray, shape (P,)
        Nearest shown vertex of every vertex: itself, if it is shown.
    """

    radiance: np.ndarray
    nearest: np.ndarray

    @classmethod
    def of(cls, proxy: Proxy, seen: np.ndarray, weight: np.ndarray) -> ShownRadiance:
        """Average what pixels show: seen, (P, 3), is Σ b I, weight, (P,), Σ b, b their blend of a vertex."""
        shown = weight > 0
        nearest = nearest_of(shown, proxy.positions)
        radiance = (seen / np.where(shown, weight, 1)[:, None]).astype(np.float32)
        return cls(radiance[nearest], nearest)

    @cached_property
    def unshown(self) -> np.ndarray:
        """Vertices that no pixel shows, (n,)."""
        return np.flatnonzero(self.nearest != np.arange(len(self.nearest)))

    def interreflection(self, proxy: Proxy) -> np.ndarray:
        """Compute the vertices' shading by interreflection, (P, 3), as if all sent what the nearest does.

        What a diffuse vertex sends to others is what photos show of it, whatever its albedo and its light.
        The back of a face sends what its front does.
        """
        return _received(proxy, self.radiance)

    def interreflection_under(
        self, proxy: Proxy, vertices: DirectionalTransport, light: np.ndarray, before: np.ndarray
    ) -> np.ndarray:
        """Compute the same where a vertex that no pixel shows has the albedo of the nearest one shown.

        Most of these lie in places that less light reaches, too.

        Parameters
        ----------
        proxy : Proxy
        vertices : DirectionalTransport
        light : ndarray, shape (M, 3)
        before : ndarray, shape (P, 3)
            The interreflection so far.
        """
        sent, unshown, nearest = self.radiance.copy(), self.unshown, self.nearest[self.unshown]
        here, there = (vertices.at(own).shading(light) + before[own] for own in (unshown, nearest))
        sent[unshown] = np.minimum(sent[unshown] / np.maximum(there, NO_LIGHT), WHITEST) * here
        return _received(proxy, sent)


def _received(proxy: Proxy, sent: np.ndarray) -> np.ndarray:
    return product(proxy.occlusion.form_factors, sent) + product(proxy.occlusion.behind, sent)
