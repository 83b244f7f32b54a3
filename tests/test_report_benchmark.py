"""The benchmark of the report: many views from a few, measured, in a page."""

from __future__ import annotations

import json

import pytest

from benchmarks.report_of_views.__main__ import main


@pytest.mark.slow
def test_seven_views_of_three_are_measured_and_shown(tmp_path):
    taken = main(["--views", "7", "--distinct", "3", "--size", "90x60", "--workspace", str(tmp_path)])
    assert taken.views == 7
    assert taken.cpu_seconds > 0 and taken.peak_bytes > 1e8
    (folder,) = tmp_path.iterdir()
    page = (folder / "report.html").read_bytes()
    assert len(page) == taken.page_bytes
    data = page.split(b'id="data">')[1].split(b"</script>")[0]
    pictures = [view["pictures"] for view in json.loads(data)["views"]]
    assert {"photo", "albedo", "shading", "normal", "depth", "confidence", "residual"} == set(pictures[0])
    assert pictures[0] == pictures[3] != pictures[1]  # views are repeated in turn
