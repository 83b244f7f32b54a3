"""Displacement of a mesh along its normals: normal equations of the photos, bending prior, and solution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from stages.stereo.refinement.settings import RefineSettings, RoughnessSettings
from stages.stereo.refinement.vertex_rings import VertexRings


@dataclass(frozen=True, eq=False)
class PixelEquations:
    """What pixels of a photo say of the heights at the corners of their faces.

    Attributes
    ----------
    faces, edges : ndarray, shape (n, 3), int32
        Corners and edges of each pixel's face.
    shares : ndarray, shape (n, 3), float64
        By how much the surface at the pixel rises, model units, with each corner's height in footprints.
    curvature, slope : ndarray, shape (n,), float64
        As `PixelTerms`.
    noise : ndarray, shape (n,), float64
        A standard normal sample.
    """

    faces: np.ndarray
    edges: np.ndarray
    shares: np.ndarray
    curvature: np.ndarray
    slope: np.ndarray
    noise: np.ndarray


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of the photos for heights x, (V,): ``½ xᵀ A x + gᵀ x`` around those at hand.

    Attributes
    ----------
    diagonal : ndarray, shape (V,), float64
        Of A.
    of_edges : ndarray, shape (E,), float64
        Its other values.
    slope : ndarray, shape (V,), float64
        g.
    sample : ndarray, shape (V,), float64
        Drawn from a normal distribution with covariance A.
    """

    diagonal: np.ndarray
    of_edges: np.ndarray
    slope: np.ndarray
    sample: np.ndarray

    @classmethod
    def none(cls, rings: VertexRings) -> NormalEquations:
        """Make those of no pixel."""
        vertices = len(rings.first) - 1
        return cls(np.zeros(vertices), np.zeros(rings.edge_count), np.zeros(vertices), np.zeros(vertices))

    def add(self, pixels: PixelEquations) -> None:
        """Add pixels, each to the corners of its face."""
        _add_pixels(
            *(pixels.faces, pixels.shares, pixels.edges, pixels.curvature, pixels.slope, pixels.noise),
            *(self.diagonal, self.of_edges, self.slope, self.sample),
        )


@dataclass(frozen=True, eq=False)
class Roughness:
    """How rough heights are expected to be: ``½ stiffness Σ weight ((L x)² + x² / reach⁴)``.

    Attributes
    ----------
    stiffness : float
    weights : ndarray, shape (V,), float64
        Small where curvature was found to be large.
    reach : float
        Over what length heights are alike, edges: both terms are as large for a wavelength of π times it.
    """

    stiffness: float
    weights: np.ndarray
    reach: float

    @property
    def hold(self) -> np.ndarray:
        """Inverse variance of the height of each vertex by itself, (V,)."""
        return self.stiffness * self.weights / self.reach**4

    def measured(
        self,
        rings: VertexRings,
        heights: np.ndarray,
        sample: np.ndarray,
        known: np.ndarray,
        settings: RoughnessSettings,
    ) -> Roughness:
        """Estimate the stiffness by maximum evidence, and its spread over places.

        Parameters
        ----------
        rings : VertexRings
        heights, sample : ndarray, shape (V,)
            The most probable ones, and a sample around them of what noise leaves open.
        known : ndarray, shape (V,), bool
            Vertices that photos say something of.
        settings : RoughnessSettings

        Notes
        -----
        MacKay 1992: ``γ / Σ w ((L x)² + x² / reach⁴)`` with γ the number of heights that the photos
        determine; the variance that is left open, over that without photos, is what they do not determine.
        """
        rough, left_open = self._roughness_of(rings, heights), self._roughness_of(rings, sample)
        weights = self.weights[known]
        share = max(1 - self.stiffness * float(np.mean(weights * left_open[known])), settings.least_share)
        mean = float(np.mean(weights * rough[known]))
        step = settings.largest_step
        wished = share / mean if mean > 0 else np.inf
        stiffness = float(np.clip(wished, self.stiffness / step, self.stiffness * step))
        around = rough
        for _ in range(settings.rings):
            around = rings.averaged(around)
        usual = float(around[known].mean())
        relative = around / usual if usual > 0 else np.ones_like(around)
        return Roughness(stiffness, (settings.tail + 1) / (settings.tail + relative), self.reach)

    def _roughness_of(self, rings: VertexRings, heights: np.ndarray) -> np.ndarray:
        """Compute what the prior weighs of heights x, (V,), at each vertex: ``(L x)² + x² / reach⁴``."""
        return rings.curvature(heights) ** 2 + heights**2 / self.reach**4


@dataclass(frozen=True, eq=False)
class HeightModel:
    """The distribution of heights, given photos and roughness: normal around the most probable ones."""

    rings: VertexRings
    equations: NormalEquations
    roughness: Roughness
    settings: RefineSettings

    def most_probable(self, heights: np.ndarray) -> np.ndarray:
        """Find the most probable heights near those at hand, (V,), by conjugate gradients (Jacobi)."""
        settings = self.settings
        bent = self.rings.squared_curvature(self._stiffnesses, heights)
        move = self._solved(-(self.equations.slope + bent + self._hold * heights))
        return heights + np.clip(move, -settings.largest_move, settings.largest_move)

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """Draw what the photos leave open, (V,): heights less the most probable ones.

        The solution for a right side with the system's covariance has its inverse (Papandreou and Yuille
        2010).
        """
        bent, held = rng.standard_normal((2, len(self.equations.diagonal)))
        spread = self.rings.transposed_curvature(np.sqrt(self._stiffnesses) * bent)
        return self._solved(self.equations.sample + spread + np.sqrt(self._hold) * held)

    @property
    def _hold(self) -> np.ndarray:
        """Inverse variance of each height by itself, (V,): never none, or what no photo shows would drift."""
        return self.roughness.hold + self.settings.hold

    @cached_property
    def _stiffnesses(self) -> np.ndarray:
        """Stiffness at each vertex, (V,): W of the roughness' matrix ``Lᵀ W L``."""
        return self.roughness.stiffness * self.roughness.weights

    def _solved(self, right: np.ndarray) -> np.ndarray:
        """Solve the system for a right side, (V,), as far as the settings' steps reach.

        In single precision: the steps wait for memory, and heights are wanted to a thousandth of a pixel.
        """
        rings, settings, single = self.rings, self.settings, np.float32
        diagonal = self.equations.diagonal + self._hold
        inverse = (1 / (diagonal + rings.squared_curvature_diagonal(self._stiffnesses))).astype(single)
        diagonal, stiffnesses = diagonal.astype(single), self._stiffnesses.astype(single)
        of_neighbours = self.equations.of_edges.astype(single)[rings.edges]

        def applied(values: np.ndarray) -> np.ndarray:
            product = rings.product(diagonal, of_neighbours, values)
            product += rings.squared_curvature(stiffnesses, values)
            return product

        shape, right = (len(right), len(right)), right.astype(single)
        system = LinearOperator(shape, matvec=applied, dtype=single)
        jacobi = LinearOperator(shape, matvec=lambda values: inverse * values, dtype=single)
        found, _ = cg(system, right, rtol=settings.solver_tolerance, maxiter=settings.solver_steps, M=jacobi)
        return found.astype(np.float64)


@numba.njit(cache=True, nogil=True)
def _add_pixels(
    faces, shares, edges_of_faces, curvature, slope, noise, diagonal, of_edges, total_slope, sample
):
    for pixel in range(len(faces)):
        deviation = np.sqrt(curvature[pixel]) * noise[pixel]
        for corner in range(3):
            vertex, share = faces[pixel, corner], shares[pixel, corner]
            after = shares[pixel, (corner + 1) % 3]
            diagonal[vertex] += curvature[pixel] * share * share
            of_edges[edges_of_faces[pixel, corner]] += curvature[pixel] * share * after
            total_slope[vertex] += slope[pixel] * share
            sample[vertex] += deviation * share
