"""What a machine and a set of photos mean for a run: sentences, and what has to be put right first."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.process.memory_limits import FAR_BEYOND
from stages.diagnosis.expectation import Expectation, expected
from stages.diagnosis.libraries import Library, what_to_do
from stages.geometry.working_size import AutoSizeSettings, affordable_size
from stages.photometry.clusters.settings import ClusterSettings

GIGA = 1e9
TWICE = 2  # the time with which a finer size is proposed
LEAST_DISK_BYTES = 10**9  # of which a workspace can grow by some photos


def on_stereo(pycolmap: Library) -> str:
    """Say whether COLMAP's PatchMatch, which `mvs.engine` may choose for dense stereo, can run."""
    facts = pycolmap.facts
    if facts["cuda"] and facts["devices"]:
        return f"with CUDA, {facts['devices']} device(s): mvs.engine=cuda takes COLMAP's PatchMatch"
    if facts["cuda"]:
        return "with CUDA, but no device: dense stereo is our own (mvs.engine)"
    more = ", though there is a CUDA device: `pycolmap-cuda12` in place of `pycolmap` can use it"
    return f"without CUDA{more if facts['devices'] else ''}; dense stereo is our own (mvs.engine)"


def on_loops(numba: Library, folder: str | None) -> str:
    """Say where compiled loops are kept, and what runs them."""
    layer = "OpenMP" if numba.facts["openmp"] else "numba's own threads, a loop at a time (no OpenMP here)"
    return f"{layer}; compiled once (about a minute), kept in {folder}"


def on_size(at_size: Expectation, threads: int, is_automatic: bool) -> str:
    """Say at which size all works, and what that takes."""
    how = " (undistort.max_size_px: auto)" if is_automatic else " (undistort.max_size_px)"
    at_least = at_size.processor_minutes / threads
    return (
        f"works at {at_size.longest_px} px of {at_size.whole_px}{how}: about "
        f"{minutes(at_size.processor_minutes)} of processor time, no less than {minutes(at_least)} on "
        f"{threads} thread(s); up to {gigabytes(at_size.memory_bytes)} of memory, "
        f"{gigabytes(at_size.disk_bytes)} on disk"
    )


def what_helps(
    sizes: Sequence[tuple[int, int]],
    at_size: Expectation,
    auto: AutoSizeSettings,
    clusters: ClusterSettings,
    is_automatic: bool,
) -> list[str]:
    """Propose what makes a run finer or shorter."""
    said = [_on_time(sizes, at_size, auto)] if is_automatic else []
    if at_size.longest_px < at_size.whole_px:
        own = expected(sizes, None, auto, clusters)
        said.append(
            f"the photos' own size (--set undistort.max_size_px=null) takes {minutes(own.processor_minutes)} "
            f"of processor time and {gigabytes(own.disk_bytes)} on disk"
        )
    return [one for one in said if one]


def _on_time(sizes: Sequence[tuple[int, int]], at_size: Expectation, auto: AutoSizeSettings) -> str:
    """Say what more time would give, or why it is exceeded; nothing where the photos have their own size."""
    if at_size.processor_minutes > auto.processor_minutes:
        return (
            f"that is more than the {minutes(auto.processor_minutes)} wanted, for images are not reduced "
            f"below {auto.least_px} px (undistort.auto.least_px): fewer photos take less"
        )
    if at_size.longest_px == at_size.whole_px:
        return ""
    allowed = TWICE * auto.processor_minutes
    finer = affordable_size(sizes, auto.model_copy(update={"processor_minutes": allowed}))
    if finer > at_size.longest_px:
        return (
            f"finer with twice the time: --set undistort.auto.processor_minutes={allowed:g} works at "
            f"{finer} px"
        )
    return (
        f"more time gives nothing finer: a view has {auto.view_megapixels:.3g} megapixels at most, for the "
        "sake of memory (undistort.auto.view_megapixels, lowered by --memory)"
    )


def library_problems(libraries: Sequence[Library]) -> list[str]:
    """Say of each library that does not load why, and what to do."""
    return [f"{one.module} does not load: {one.fault}. {what_to_do(one)}" for one in libraries if one.fault]


def loop_problems(folder: str | None) -> list[str]:
    """Say where compiled loops cannot be kept."""
    said = "No folder for compiled loops can be written; set NUMBA_CACHE_DIR to one that can."
    return [] if folder else [said]


def memory_problems(free: int | None, needed: int | None, least: int) -> list[str]:
    """Say where memory is too little, all in bytes.

    Parameters
    ----------
    free : int or None
    needed : int or None
        By the photos; None without any.
    least : int
        With which anything can be run.
    """
    if free is None:
        return []
    if free < least:
        return [
            f"{gigabytes(free)} of memory are free, and any run takes {gigabytes(least)}: end other programs."
        ]
    if needed is not None and needed > FAR_BEYOND * free:
        return [
            f"The photos take up to {gigabytes(needed)} of memory, and {gigabytes(free)} are free: end other "
            f"programs, or give --memory {free / GIGA:.1f}GB."
        ]
    return []


def disk_problems(free: int, needed: int | None, place: str, may_write: bool) -> list[str]:
    """Say where the workspace has no place; bytes."""
    if not may_write:
        return [f"{place} may not be written; give another place with --workspace DIR."]
    wanted = LEAST_DISK_BYTES if needed is None else needed
    if free < wanted:
        return [
            f"{place} has {gigabytes(free)} free, and {gigabytes(wanted)} are needed; make room, or give "
            "another place with --workspace DIR."
        ]
    return []


def gigabytes(size: float) -> str:
    """Format bytes in GB."""
    return f"{size / GIGA:.{0 if size >= 100 * GIGA else 1}f} GB"


def minutes(time: float) -> str:
    """Format minutes: hours from three on."""
    return f"{time / 60:.0f} hours" if time >= 180 else f"{max(time, 1):.0f} min"
