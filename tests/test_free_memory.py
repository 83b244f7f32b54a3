"""Memory that is free goes back to the system, where the C library is glibc."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import MachineError
from pipeline.process.meter import kilobytes, measured, resident_bytes
from pipeline.process.own_process import in_own_process, in_own_processes
from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.decimation.proxy import roughly_decimated
from stages.geometry.decimation.simplification import FEW_FACES
from stages.geometry.settings import ProxySettings

STATUS = Path("/proc/self/status")
ROOT = Path(__file__).resolve().parent.parent

# A block of 30 MiB that is let go raises glibc's limit; one of 16 MiB then comes from its heap, and stays
# there when it is let go, since a small one lies above it.
LEFT_BEHIND = """
import ctypes, sys
from contextlib import ExitStack
from pipeline.process.free_memory import give_back_free_memory, large_blocks_apart
from pipeline.process.meter import resident_bytes

libc = ctypes.CDLL(None)
libc.malloc.restype, libc.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
libc.free.restype, libc.free.argtypes = None, [ctypes.c_void_p]
apart = ExitStack()
if "apart" in sys.argv or "after" in sys.argv:
    apart.enter_context(large_blocks_apart())
if "after" in sys.argv:
    apart.close()
libc.free(libc.malloc(30 << 20))
before = resident_bytes()
large = libc.malloc(16 << 20)
ctypes.memset(large, 1, 16 << 20)
small = libc.malloc(100_000)
libc.free(large)
if "trim" in sys.argv:
    give_back_free_memory()
print((resident_bytes() - before) / 2**20)
"""


def left_behind_mib(*how: str) -> float:
    """What is left of 16 MiB that were let go."""
    command = [sys.executable, "-c", LEFT_BEHIND, *how]
    return float(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")
@pytest.mark.parametrize("how", ["apart", "trim"])
def test_large_blocks_that_are_let_go_go_back_to_the_system(how):
    """Without it glibc keeps them."""
    if left_behind_mib() < 15:
        pytest.skip("this C library keeps nothing")
    assert left_behind_mib(how) < 2


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")
def test_afterwards_blocks_are_kept_as_before():
    """Arrays of single views that come and go would otherwise have their pages cleared each time."""
    if left_behind_mib() < 15:
        pytest.skip("this C library keeps nothing")
    assert left_behind_mib("after") > 15


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")
def test_a_mesh_that_was_decimated_leaves_no_memory_behind():
    """`fast_simplification` keeps its vectors until its process ends: 130 MB of this one."""
    faces, left_kilobytes = in_own_process("that decimates a grid", decimated_grid)
    assert faces == pytest.approx(20_000, rel=0.01) and left_kilobytes < 40_000


def decimated_grid() -> tuple[int, int]:
    """Decimate a grid in a process that has done nothing else: faces, and memory that it has more; kB."""
    surface = wavy_grid(490)
    assert len(surface.faces) > FEW_FACES
    roughly_decimated(wavy_grid(20), 500, ProxySettings())  # loads what stays
    before = kilobytes(STATUS, "VmRSS")
    small = roughly_decimated(surface, 20_000, ProxySettings())
    return len(small.faces), kilobytes(STATUS, "VmRSS") - before


def test_a_process_of_its_own_gives_back_the_result_or_the_error():
    assert in_own_process("that divides", divmod, 17, 5) == (3, 2)
    with pytest.raises(ZeroDivisionError):
        in_own_process("that divides", divmod, 17, 0)
    assert in_own_process("that tells its number", os.getpid) != os.getpid()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")
def test_a_process_of_its_own_does_not_count_what_this_one_holds_as_its_peak():
    """`ru_maxrss` of a new process begins at what the one before held: 400 MB would count twice."""
    held = np.ones(50_000_000)
    with measured() as reading:
        in_own_process("that tells its number", os.getpid)
    assert held.nbytes < reading.peak_bytes < resident_bytes() + held.nbytes // 2


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")
def test_processes_run_at_the_same_time_and_their_peaks_add_up(tmp_path):
    with measured() as reading:
        met = in_own_processes("that meet", meet, [(tmp_path, "one", "other"), (tmp_path, "other", "one")])
    assert met == [True, True]
    assert reading.peak_bytes > resident_bytes() + 300_000_000


def meet(folder: Path, own: str, other: str) -> bool:
    """Hold 150 MB until the other process is there, a minute at most: whether it came."""
    held = np.ones(150_000_000, np.uint8)
    (folder / own).touch()
    until = time.monotonic() + 60
    while not (folder / other).exists() and time.monotonic() < until:
        time.sleep(0.01)
    return (folder / other).exists() and bool(held.all())


def test_a_process_that_the_system_ends_is_a_sentence():
    with pytest.raises(MachineError, match="process that ends at once ended before its time.*memory"):
        in_own_process("that ends at once", os._exit, 9)


LONG = """
import sys, time
from pipeline.process.own_process import in_own_process

if __name__ == "__main__":
    print("began", flush=True)
    in_own_process("that sleeps", time.sleep, 600)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")
def test_a_process_of_its_own_ends_with_the_one_that_began_it(tmp_path):
    """Which Ctrl-C kills at once: nobody would end it otherwise, nor free its memory."""
    (tmp_path / "long.py").write_text(LONG, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, tmp_path / "long.py"], env=environment) as parent:
        until(lambda: len(children_of(parent.pid)) == 2)  # the other follows resources
        begun = children_of(parent.pid)
        time.sleep(1.0)  # it has told the system whom it follows
        parent.kill()
    until(lambda: not any(Path(f"/proc/{child}").exists() for child in begun))


def children_of(process: int) -> list[int]:
    """Numbers of the processes that a process has begun."""
    found = []
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended
            of_parent = file.read_text().rpartition(")")[2].split()[1]
            found += [int(file.parent.name)] if int(of_parent) == process else []
    return found


def until(holds: Callable[[], bool], patience_s: float = 60.0) -> None:
    """Wait for something to hold."""
    deadline = time.monotonic() + patience_s
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_the_peak_of_a_process_of_its_own_counts():
    with measured() as reading:
        in_own_process("that fills memory", bytes, 400_000_000)
    assert reading.peak_bytes > 800_000_000  # there, and of the answer here


def wavy_grid(side: int) -> Surface:
    """A height field of side × side vertices."""
    x, y = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    vertices = np.stack([x, y, 0.01 * np.sin(40 * x) * np.cos(30 * y)], axis=-1).reshape(-1, 3)
    place = np.arange(side * side, dtype=np.int32).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (place[:-1, :-1], place[1:, :-1], place[:-1, 1:], place[1:, 1:]))
    return Surface(vertices, np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]))
