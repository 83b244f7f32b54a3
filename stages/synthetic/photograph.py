"""Photographs with as many samples as a stated noise asks for; the noise is measured, not guessed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stages.scene.cameras import Camera
from stages.synthetic.render import Quality, Scene, Tile, tiles_of

ROUNDS = 8


@dataclass(frozen=True)
class Noise:
    """How far a picture's pixels lie from their true values, measured between independent passes.

    Attributes
    ----------
    all : float
        Root mean square over the mask and all channels, as a share of the scene's level.
    channels : tuple of float
        The same for each channel, over that channel's own mean in this picture.
    samples_per_pixel : float
        For each light source, on average over the picture.
    """

    all: float
    channels: tuple[float, float, float]
    samples_per_pixel: float


class _Passes:
    """Sums over the passes of one picture; tiles may take different numbers of passes."""

    def __init__(self, scene: Scene, camera: Camera, quality: Quality, seed: int):
        self._scene, self._camera, self._quality, self._seed = scene, camera, quality, seed
        self._sum = np.zeros((*camera.shape, 3))
        self._squares = np.zeros((*camera.shape, 3))
        self.count = np.zeros(camera.shape)

    def add(self, tile: Tile, until: int) -> None:
        """Render a tile until it has had `until` passes; pass k is seeded with ``seed + k``."""
        done = int(self.count[tile.slices].flat[0])
        for k in range(done, until):
            image = self._scene.photograph(self._camera, self._quality, self._seed + k, tile)
            self._sum[tile.slices] += image
            self._squares[tile.slices] += image.astype(np.float64) ** 2
        self.count[tile.slices] = max(done, until)

    def mean(self) -> np.ndarray:
        """Mean of the passes, shape (height, width, 3)."""
        return self._sum / self.count[..., None]

    def variance(self) -> np.ndarray:
        """Of a single pass, unbiased, shape (height, width, 3)."""
        count = self.count[..., None]
        return np.maximum(self._squares - self._sum**2 / count, 0) / (count - 1)

    def noise(self, mask: np.ndarray, level: float) -> Noise:
        """Noise of the mean of the passes; none where the mask is empty, as it is of a sheet seen edge on."""
        samples = float(self.count.mean()) * self._quality.samples
        if not mask.any():
            return Noise(0.0, (0.0, 0.0, 0.0), samples)
        mean, variance = self.mean()[mask], (self.variance() / self.count[..., None])[mask]
        red, green, blue = (_ratio(variance[:, c], float(mean[:, c].mean())) for c in range(3))
        return Noise(_ratio(variance, level), (red, green, blue), samples)


@dataclass(frozen=True)
class NoiseTarget:
    """What noise is good enough.

    Attributes
    ----------
    share : float
        `Noise.all`, at most.
    level : float
        The value that it is a share of: the mean over all masked pixels and channels of all views, so that a
        view from the dark side is not asked for more than the others.
    """

    share: float
    level: float


def mean_level(scene: Scene, cameras: list[Camera], masks: list[np.ndarray], quality: Quality) -> float:
    """Mean value over the masks of all views, from a few samples per pixel."""
    few = replace(quality, samples=4)
    values = [
        scene.photograph(camera, few, seed=0)[mask] for camera, mask in zip(cameras, masks, strict=True)
    ]
    return float(np.concatenate(values).mean())


def photograph(
    scene: Scene, camera: Camera, mask: np.ndarray, quality: Quality, target: NoiseTarget, seed: int
) -> tuple[np.ndarray, Noise]:
    """Two passes over everything, then more where light is noisiest, until their mean is good enough.

    Parameters
    ----------
    mask : ndarray, shape (height, width), bool
        Where the noise counts.
    quality : Quality
        Of one pass.
    target : NoiseTarget
    seed : int

    Returns
    -------
    image : ndarray, shape (height, width, 3), float32
        Linear.
    noise : Noise
        As measured; over what was wanted only where `ROUNDS` did not suffice.
    """
    passes = _Passes(scene, camera, quality, seed)
    tiles = tiles_of(camera)
    for tile in tiles:
        passes.add(tile, until=2)
    for _ in range(ROUNDS):
        if passes.noise(mask, target.level).all <= target.share:
            break
        for tile, until in zip(tiles, _passes_wanted(passes, tiles, mask, target), strict=True):
            passes.add(tile, until)
    return passes.mean().astype(np.float32), passes.noise(mask, target.level)


def _passes_wanted(passes: _Passes, tiles: list[Tile], mask: np.ndarray, target: NoiseTarget) -> list[int]:
    """Passes per tile that reach the noise at the least cost, by the variances seen so far.

    Minimising Σ_t N_t n_t under ``Σ_t S_t / n_t = (share · level)² N`` gives n_t in proportion to
    ``√(S_t / N_t)``, S_t the variance of one pass summed over the N_t pixels of tile t that count.
    """
    variance = passes.variance().sum(axis=-1) * mask
    sums = np.array([variance[tile.slices].sum() for tile in tiles])
    sizes = np.array([max(np.count_nonzero(mask[tile.slices]), 1) for tile in tiles])
    allowed = (
        (0.97 * target.share * target.level) ** 2 * 3 * np.count_nonzero(mask)
    )  # a little less: estimates scatter
    wanted = np.sqrt(sums / sizes) * np.sqrt(sums * sizes).sum() / allowed
    return np.ceil(np.minimum(wanted, 4 * passes.count.max())).astype(int).tolist()


def _ratio(variance: np.ndarray, level: float) -> float:
    return float(np.sqrt(variance.mean())) / level if level > 0 else 0.0
