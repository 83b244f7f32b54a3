"""The walls of the house: who may import whom, and what may not be called where."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic.fields import FieldInfo

from pipeline import Settings
from pipeline.settings import is_group
from stages import ALL_STAGES
from stages.scene.distributions import OPEN3D, PYCOLMAP

ROOT = Path(__file__).parent.parent
PIXEL_LIBRARIES = {
    "numpy",
    "scipy",
    "cv2",
    "fast_simplification",
    "open3d",
    "pycolmap",
    "OpenEXR",
    "PIL",
    "numba",
    "mitsuba",
    "trimesh",
    "stages",
}
SLOW_TO_IMPORT = {
    "numpy",
    "scipy",
    "cv2",
    "fast_simplification",
    "open3d",
    "pycolmap",
    "OpenEXR",
    "numba",
    "mitsuba",
    "pooch",
    "PIL",
    "trimesh",
}
FOLDERS_BELOW = {  # which folders of stages/ each folder may import
    "command": {"additions", "command", "diagnosis", "evaluation", "reporting", "formats", "scene"},
    "diagnosis": {"diagnosis", "photometry", "geometry", "solvers", "formats", "scene"},
    "evaluation": {"evaluation", "formats", "scene"},
    "scene": {"scene"},
    "formats": {"formats", "scene"},
    "solvers": {"solvers", "scene"},
    "motion": {"motion", "formats", "scene"},
    "stereo": {"stereo", "geometry", "solvers", "formats", "scene"},
    "geometry": {"geometry", "solvers", "formats", "scene"},
    "photometry": {"photometry", "solvers", "formats", "scene"},
    "texturing": {"texturing", "geometry", "solvers", "formats", "scene"},
    "reporting": {"reporting", "texturing", "geometry", "solvers", "formats", "scene"},
    "synthetic": {"synthetic", "geometry", "formats", "scene"},
}
ROOMS_BELOW = {  # within a folder: which of its rooms each room may import, itself besides
    "photometry/calibration": set(),
    "photometry/paper": set(),
    "photometry/transport": {"paper"},
    "photometry/specular": {"transport"},
    "photometry/light_search": {"transport", "specular"},
    "photometry/sun": {"light_search", "transport"},
    "photometry/lighting": {"clusters", "light_search", "sun", "transport", "specular"},
    "photometry/joint": {"paper", "transport"},
    "photometry/detail": set(),
    "photometry/relief": {"lighting", "light_search", "transport"},
    "photometry/further_views": {"clusters", "lighting", "light_search", "sun", "transport", "specular"},
    "photometry/albedo": {"joint", "detail", "specular"},
    "photometry/clusters": set(),
    "photometry/albedo_of_clusters": {"albedo", "clusters", "detail", "joint", "paper"},
    "solvers/kernels": set(),
    "solvers/least_squares": set(),
    "solvers/primal_dual": {"kernels"},
    "geometry/covisibility": set(),
    "geometry/decimation": set(),
    "geometry/outlines": set(),
    "formats/colour": set(),
    "formats/decoders": set(),
    "formats/images": {"colour", "decoders"},
    "formats/meshes": {"images", "colour"},
    "formats/colmap": {"images"},
    "formats/cameras": {"colmap", "images"},
    "formats/artefacts": {"images", "decoders"},
    "motion/known_poses": set(),
    "motion/unknown_poses": set(),
    "stereo/depth": set(),
    "stereo/refinement": set(),
    "reporting/content": set(),
    "reporting/document": set(),
    "reporting/comparison": {"content", "document"},
    "synthetic/subjects": set(),
    "synthetic/paints": set(),
}
GROUND = {  # files beside the rooms that they may import; the others lead them
    "photometry": {"stack", "albedo_data", "chromaticity", "neighbourhoods"},
    "geometry": {"occluders", "settings", "short_edges", "surface"},
    "motion": {
        *("database", "features", "focal_lengths", "mapping", "matching", "pairs", "photo_set", "placeable"),
        *("positions", "retrieval", "room", "sfm_settings"),
    },  # all: these two rooms lead
    "stereo": {"mvs_settings", "view_selection"},
    "reporting": {"settings", "parts"},
}
LEADING = {  # rooms that lead others as files beside them do: which of these they may import as well
    "photometry/albedo_of_clusters": {"decomposition_settings", "decomposition_record", "energy_history"},
}
LENT = {  # who may import a library whose objects are its own world; everyone else takes arrays
    "pycolmap": {
        "sfm.py",
        "undistort.py",
        "formats/cameras/colmap_model.py",
        "formats/colmap/adoption.py",
        "formats/colmap/assembly.py",
        "formats/colmap/binary_files.py",
        "formats/colmap/model.py",
        "formats/colmap/plausible_cameras.py",
        # The steps of `sfm`, each of which hands COLMAP a database or a model.
        "motion/focal_lengths.py",
        "motion/database.py",
        "motion/features.py",
        "motion/mapping.py",
        "motion/matching.py",
        "motion/pairs.py",
        "motion/photo_set.py",
        "motion/known_poses/triangulation.py",
        "motion/unknown_poses/placement.py",
        "motion/unknown_poses/survey.py",
        "motion/retrieval.py",  # COLMAP's index of visual words
        "stereo/colmap_stereo.py",  # the engine `cuda` of `mvs`
        "stereo/stored_depth_maps.py",  # COLMAP's fusion
        "stereo/cuda_cards.py",  # whether pycolmap has CUDA, and a card
        "geometry/lenses.py",  # lenses are COLMAP's models; a second implementation of them would differ
    },
    "open3d": {
        "geometry/occluders.py",
        "geometry/rays.py",
        "geometry/surface.py",  # the core of `mesh`: Poisson, smoothing, decimation
        "formats/meshes/triangle_meshes.py",  # the crossing between our meshes and open3d's
    },
}
PIPELINE_ROOMS_BELOW = {  # what each room of pipeline/ may import, itself besides
    "files": {"errors"},
    "cache": {"files", "errors", "settings", "stage"},
    "process": {"files", "errors", "settings", "stage", "job"},
    "cluster": {"files", "errors", "cache", "process"},
}  # its files beside them lead the rooms, and `command` leads all
CROWDED = 12  # files that a room holds at most; steps and tests are lists, not rooms
DISTRIBUTIONS = {  # of what is imported by another name than it is installed by
    "cv2": {"opencv-python-headless"},
    "fast_simplification": {"fast-simplification"},
    "open3d": set(OPEN3D),
    "OpenEXR": {"openexr"},
    "PIL": {"pillow"},
    "pi_heif": {"pi-heif"},
    "pycolmap": set(PYCOLMAP),
    "skimage": {"scikit-image"},
}
CHANGES_NO_RESULT = {"pydantic"}  # it checks settings; what they say is in the key
VAGUE = {"utils", "util", "common", "helpers", "helper", "base", "misc"}
NO_STEPS = {"__init__", "additions", "cli"}
STEPS = {path.stem for path in (ROOT / "stages").glob("*.py")} - NO_STEPS


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def imported(tree: ast.AST) -> set[str]:
    """Every module named in an import statement."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def imported_at_once(tree: ast.Module) -> set[str]:
    """Modules imported when the file is: not inside functions, not for type checkers only."""
    statements = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    return set().union(*(imported(ast.Module([node], [])) for node in statements), set())


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


class WhenRun(ast.NodeTransformer):
    """Leaves out what is imported for type checkers only."""

    def visit_If(self, node: ast.If) -> ast.AST | None:
        return None if ast.unparse(node.test) == "TYPE_CHECKING" else self.generic_visit(node)


def source_of(name: str) -> Path:
    """The file of a module of stages/, or of the module that something is imported from."""
    path = ROOT.joinpath(*name.split("."))
    return next(file for file in (path.with_suffix(".py"), path.parent.with_suffix(".py")) if file.is_file())


def libraries_of(module: str) -> set[str]:
    """What a module of stages/ imports from outside when it runs, itself or through others of stages/."""
    names, libraries, seen = [module], set(), set()
    while names:
        name = names.pop()
        if not name.startswith("stages."):
            libraries.add(name.split(".")[0])
        elif (path := source_of(name)) not in seen:
            seen.add(path)
            names += imported(WhenRun().visit(parsed(path)))
    return libraries - sys.stdlib_module_names - {"pipeline"}


@pytest.mark.parametrize("path", sources("pipeline"), ids=lambda path: path.name)
def test_the_pipeline_has_never_heard_of_a_pixel(path):
    assert not {name.split(".")[0] for name in imported(parsed(path))} & PIXEL_LIBRARIES


@pytest.mark.parametrize("room", PIPELINE_ROOMS_BELOW)
def test_arrows_point_one_way_between_rooms_of_the_pipeline(room):
    for path in sources(f"pipeline/{room}"):
        for name in imported(parsed(path)):
            parts = name.split(".")
            if parts[0] == "pipeline" and len(parts) > 1:
                assert parts[1] in PIPELINE_ROOMS_BELOW[room] | {room}, f"{path} imports {name}"


def test_only_the_command_line_imports_the_verbs():
    for path in sources("pipeline"):
        names = {name.split(".")[1] for name in imported(parsed(path)) if name.startswith("pipeline.")}
        assert "command" not in names or path.parent.name == "command", path


QUICK_TO_IMPORT = [*sorted((ROOT / "stages").glob("*.py")), *sources("stages/command")]


@pytest.mark.parametrize("path", QUICK_TO_IMPORT, ids=lambda path: str(path.relative_to(ROOT)))
def test_declarations_import_at_once_so_that_a_plan_answers_at_once(path):
    assert not {name.split(".")[0] for name in imported_at_once(parsed(path))} & SLOW_TO_IMPORT


@pytest.mark.parametrize("folder", FOLDERS_BELOW)
def test_arrows_point_one_way(folder):
    for path in sources(f"stages/{folder}"):
        for name in imported(parsed(path)):
            parts = name.split(".")
            if parts[0] == "stages" and len(parts) > 1:
                assert parts[1] in FOLDERS_BELOW[folder], f"{path} imports {name}"


@pytest.mark.parametrize("room", ROOMS_BELOW)
def test_arrows_point_one_way_between_rooms(room):
    folder, own = room.split("/")
    rooms = {path.name for path in (ROOT / "stages" / folder).iterdir() if path.is_dir()}
    for path in sources(f"stages/{room}"):
        for name in imported(parsed(path)):
            parts = name.split(".")
            if parts[:2] != ["stages", folder]:
                continue
            beside = GROUND.get(folder, set()) | LEADING.get(room, set())
            allowed = ROOMS_BELOW[room] | {own} if parts[2] in rooms else beside
            assert parts[2] in allowed, f"{path} imports {name}"


@pytest.mark.parametrize("room", LEADING)
def test_what_a_leading_room_imports_does_not_import_it(room):
    folder, own = room.split("/")
    for name in LEADING[room]:
        assert f"stages.{folder}.{own}" not in (ROOT / f"stages/{folder}/{name}.py").read_text(), name


@pytest.mark.parametrize("library", LENT)
def test_pycolmap_and_open3d_are_imported_where_they_are_listed_and_nowhere_else(library):
    """In functions and for type checkers as well; a file that needs it no longer leaves the list."""
    found = {
        path.relative_to(ROOT / "stages").as_posix()
        for path in sources("stages")
        if library in {name.split(".")[0] for name in imported(parsed(path))}
    }
    assert found == LENT[library]


def test_every_room_is_walled_and_has_no_more_files_than_one_can_survey():
    for folder in (path for path in (ROOT / "stages").rglob("*") if path.is_dir() and any(path.glob("*.py"))):
        place = folder.relative_to(ROOT / "stages").as_posix()
        assert place in FOLDERS_BELOW or "/".join(place.split("/")[:2]) in ROOMS_BELOW, place
        assert files_in(folder) <= CROWDED, place
    for folder in (ROOT / "pipeline", *(path for path in (ROOT / "pipeline").iterdir() if path.is_dir())):
        assert files_in(folder) <= CROWDED, folder


def files_in(folder: Path) -> int:
    """Number of its modules."""
    return len([path for path in folder.glob("*.py") if path.stem != "__init__"])


@pytest.mark.parametrize("step", sorted(STEPS))
def test_a_step_leans_on_neither_the_command_line_nor_what_judges_it(step):
    names = {name for name in imported(parsed(ROOT / f"stages/{step}.py")) if name.startswith("stages.")}
    assert {name.split(".")[1] for name in names} <= FOLDERS_BELOW.keys() - {"command", "evaluation"}


@pytest.mark.parametrize("path", sources("stages"), ids=lambda path: str(path.relative_to(ROOT)))
def test_nobody_imports_a_step_but_the_dataflow_and_the_command_line(path):
    if path.parent == ROOT / "stages" and path.stem in NO_STEPS:
        return
    steps = {name.split(".")[1] for name in imported(parsed(path)) if name.startswith("stages.")} & STEPS
    assert not steps


@pytest.mark.parametrize("stage", ALL_STAGES, ids=lambda stage: stage.name)
def test_the_key_knows_the_version_of_every_library_that_a_stage_can_reach(stage):
    libraries = libraries_of(stage.run.__module__) - CHANGES_NO_RESULT
    assert set(stage.tools) == set().union(*(DISTRIBUTIONS.get(name, {name}) for name in libraries))


def test_no_name_gathers_everything():
    everything = {part for path in sources("pipeline", "stages") for part in (*path.parts, path.stem)}
    assert not everything & VAGUE


@pytest.mark.parametrize("path", sources("pipeline", "stages"), ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_prints_asserts_or_swallows(path):
    for node in ast.walk(parsed(path)):
        assert not isinstance(node, ast.Assert), f"{path}:{node.lineno} asserts"
        if isinstance(node, ast.ExceptHandler):
            assert node.type is not None, f"{path}:{node.lineno} is a bare except"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id != "print", f"{path}:{node.lineno} prints"


def test_every_setting_has_a_reason_and_can_be_reached_from_the_command_line():
    import stages
    from pipeline.config import check_settings, override

    declared = {stage.name: stage.settings for stage in stages.ALL_STAGES}
    defaults = check_settings(declared, {})
    for stage, kind in declared.items():
        for name, field in all_settings(kind):
            assert field.description, f"{stage}.{name} says nothing about itself"
            value = defaults[stage].model_dump(mode="json", by_alias=True)
            for part in name.split("."):
                value = value[part]
            text = "null" if value is None else str(value).replace("'", '"')
            if not is_group(field.annotation):
                assert check_settings(declared, override({}, [f"{stage}.{name}={text}"])) == defaults


def all_settings(kind: type[Settings]) -> Iterator[tuple[str, FieldInfo]]:
    """Public names and fields, those of phases and the phases themselves as well."""
    for name, field in kind.model_fields.items():
        public = field.alias or name
        yield public, field
        if is_group(field.annotation):
            yield from ((f"{public}.{own}", inner) for own, inner in all_settings(field.annotation))


@pytest.mark.parametrize("stage", ALL_STAGES, ids=lambda stage: stage.name)
def test_a_stage_ignores_only_settings_that_it_has(stage):
    assert set(stage.ignores) <= {name for name, _ in all_settings(stage.settings)}


def test_what_has_moved_is_where_its_refusal_says():
    places = {f"{stage.name}.{name}" for stage in ALL_STAGES for name, _ in all_settings(stage.settings)}
    for stage in ALL_STAGES:
        fields = [field.annotation for _, field in all_settings(stage.settings)]
        for kind in (stage.settings, *filter(is_group, fields)):
            assert set(kind.moved.values()) <= places
            assert not set(kind.moved) & {field.alias or name for name, field in kind.model_fields.items()}


def test_no_stage_takes_what_one_after_it_in_order_gives():
    from stages import IN_ORDER

    assert {stage.name for stage in IN_ORDER} == {stage.name for stage in ALL_STAGES}
    for place, stage in enumerate(IN_ORDER):
        later = {artefact.name for other in IN_ORDER[place:] for artefact in other.gives}
        assert not later & {*stage.takes, *stage.may_take}, stage.name


def test_every_dataflow_is_sound():
    import stages
    from pipeline.request import check_flow
    from stages import additions

    for given in (
        ["images"],
        ["images", "colmap"],
        ["images", "colmap", "mesh_file"],
        ["images", "masks"],
        ["images", "camera_file"],
        ["images", "colmap", "points_file"],
    ):
        for light in ("paper", "harmonics", "directions"):
            check_flow(stages.dataflow(given, light), stages.SOURCES)
    for given in ([], ["object"], ["environment"], ["object", "environment"]):
        for light in ("paper", "harmonics", "directions"):
            flow = additions.with_full_resolution(additions.with_relighting(stages.experiment(given, light)))
            flow = additions.with_report(flow)
            check_flow(flow, stages.kinds_of_sources(flow))
            for whole in (stages.dataflow(["images"], light), stages.experiment(given, light)):
                flow = additions.with_report(additions.with_delit_photos(additions.with_texture(whole)))
                check_flow(flow, stages.kinds_of_sources(flow))
