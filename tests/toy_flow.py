"""A dataflow of three nodes that has never heard of a pixel: words are joined, counted, and reported."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from pipeline import Artefact, Job, Settings, Silence, Source, Stage, UserError, setting
from pipeline.config import check_settings
from pipeline.request import Request, Selection
from pipeline.run import run


class JoinSettings(Settings):
    separator: str = setting(" ", "Between two words.")
    chatty: bool = setting(False, "Says more, changes nothing.", changes_result=False)


class CountSettings(Settings):
    moved = MappingProxyType({"glue": "join.separator"})
    times: int = setting(1, "The count is multiplied by this.", ge=1, le=100)
    lambda_: float = setting(1.0, "A name that Python reserves.", name="lambda", gt=0)


class ReportSettings(Settings):
    pass


def join(job: Job) -> None:
    words = [path.read_text() for path in sorted(job.inputs["words"].glob("*.txt"))]
    if "poison" in words:
        raise UserError("A word is poison; expected an edible one. Remove it.")
    job.outputs["text"].write_text(job.settings.separator.join(words))
    job.note(words=len(words))


def count(job: Job) -> None:
    length = len(job.inputs["text"].read_text()) * job.settings.times
    (job.outputs["numbers"] / "length.txt").write_text(str(length))


def report(job: Job) -> None:
    job.outputs["page"].write_text(f"<{(job.inputs['numbers'] / 'length.txt').read_text()}>")


JOIN = Stage(
    "join", 1, "Joins.", JoinSettings, ("words",), (Artefact("text", "all words", file="text.txt"),), join
)
COUNT = Stage(
    "count", 1, "Counts.", CountSettings, ("text",), (Artefact("numbers", "counts", output="numbers"),), count
)
REPORT = Stage(
    "report",
    1,
    "Reports.",
    ReportSettings,
    ("numbers",),
    (Artefact("page", "a page", file="page.txt", output="page.txt"),),
    report,
)
FLOW = (JOIN, COUNT, REPORT)
WORDS = Source("words", (".txt",))


@dataclass
class Witness(Silence):
    """A listener that remembers: per run, what happened to each stage and what was said."""

    actions: dict[str, str] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    plan: dict[str, str] = field(default_factory=dict)

    def planned(self, decisions, earlier):
        self.plan = {one.stage.name: one.action.value for one in decisions}

    def deciding(self, decision):
        self.actions[decision.stage.name] = decision.action.value
        self.reasons[decision.stage.name] = decision.reason

    def finished(self, decision, record):
        pass

    def say(self, sentence):
        self.said.append(sentence)

    @property
    def ran(self) -> list[str]:
        return [stage for stage, action in self.actions.items() if action == "run"]


def request(root: Path, flow=FLOW, settings=None, words="words", **selection) -> Request:
    """A request on `root/words`, or another source below `root`, and `root/workspace`."""
    declared = {stage.name: stage.settings for stage in flow}
    return Request(
        flow=flow,
        settings=check_settings(declared, settings or {}),
        sources={"words": root / words},
        kinds=(WORDS,),
        workspace=root / "workspace",
        selection=Selection(**selection),
    )


def run_toy(root: Path, **wishes) -> Witness:
    """Run it and return the witness."""
    witness = Witness()
    run(request(root, **wishes), witness)
    return witness


def write_words(root: Path, **words: str) -> None:
    """`one="tree"` becomes words/one.txt."""
    (root / "words").mkdir(exist_ok=True)
    for name, word in words.items():
        (root / "words" / f"{name}.txt").write_text(word)
