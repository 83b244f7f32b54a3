"""A small build tool that is independent of images: declares, plans, runs, caches and explains stages."""

from pipeline.errors import MachineError, UserError
from pipeline.files.json_text import finite_or_null, json_text
from pipeline.job import Job, Progress, Silence, counted
from pipeline.settings import Settings, group, setting, settings_that_matter
from pipeline.stage import AnyStage, Artefact, Flow, Source, Stage, former_names, settings_of

__all__ = [
    "AnyStage",
    "Artefact",
    "Flow",
    "Job",
    "MachineError",
    "Progress",
    "Settings",
    "Silence",
    "Source",
    "Stage",
    "UserError",
    "counted",
    "finite_or_null",
    "former_names",
    "group",
    "json_text",
    "setting",
    "settings_of",
    "settings_that_matter",
]
