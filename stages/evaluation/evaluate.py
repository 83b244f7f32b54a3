"""Evaluation of two folders: views paired by name, compared where both are valid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import UserError, finite_or_null
from stages.evaluation.agreement import Correspondences
from stages.evaluation.albedo_folder import AlbedoFolder, open_albedo_folder
from stages.evaluation.judged_views import JudgedView, check_size, judge_view
from stages.evaluation.scores import SCALING, Scores, score_albedo
from stages.formats.artefacts.correspondence_files import read_correspondences
from stages.scene.wording import listed


@dataclass(frozen=True)
class Report:
    """The scores, and a description of what was compared.

    Attributes
    ----------
    prediction_space, truth_space : str
        How the maps were read.
    coverage : float
        Share of the truth's masks, in the views compared, that the prediction covers; nan without such masks.
    only_in_prediction, only_in_truth : tuple of str
        Views without a counterpart; they are not evaluated.
    scores : Scores
    notes : tuple of str
        Further remarks for the reader.
    """

    prediction_space: str
    truth_space: str
    coverage: float
    only_in_prediction: tuple[str, ...]
    only_in_truth: tuple[str, ...]
    scores: Scores
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values."""
        return {
            "colour_space": {"prediction": self.prediction_space, "truth": self.truth_space},
            "scaling": SCALING,
            "coverage": finite_or_null(self.coverage),
            "only_in_prediction": list(self.only_in_prediction),
            "only_in_truth": list(self.only_in_truth),
            **self.scores.as_json(),
            "remarks": [*self.notes, *self.scores.remarks()],
        }


def evaluate_folders(
    prediction_folder: Path,
    truth_folder: Path,
    masks: Path | None = None,
    correspondences: Path | None = None,
    step: Callable[[], None] = lambda: None,
) -> Report:
    """Evaluate the albedo maps of one folder against those of another.

    Parameters
    ----------
    prediction_folder, truth_folder : Path
        As `open_albedo_folder` takes them.
    masks : Path, optional
        Where to evaluate, instead of the prediction's own masks; the truth's masks always apply.
    correspondences : Path, optional
        Output of the `correspondence` stage, for the agreement between views.
    step : callable
        Called after each view.

    Raises
    ------
    UserError
        The folders have an error that the user can correct.
    """
    prediction = open_albedo_folder(prediction_folder, masks)
    truth = open_albedo_folder(truth_folder)
    names = common_names(prediction, truth)
    views, own_masks, known, covered = [], {}, 0, 0
    for name in names:
        view, own, true_mask = _pair(name, prediction, truth)
        views.append(view)
        own_masks[name] = own
        if true_mask is not None:
            known, covered = known + int(true_mask.sum()), covered + int(view.judged.sum())
        step()
    links = None if correspondences is None else read_correspondences(correspondences)
    return Report(
        prediction_space=prediction.colour_space(names),
        truth_space=truth.colour_space(names),
        coverage=covered / known if known else float("nan"),
        only_in_prediction=tuple(name for name in prediction.files if name not in truth.files),
        only_in_truth=tuple(name for name in truth.files if name not in prediction.files),
        scores=score_albedo(
            views, truth.part_names, None if links is None else Correspondences(links, own_masks)
        ),
        notes=_notes(prediction, truth, views),
    )


def common_names(prediction: AlbedoFolder, truth: AlbedoFolder) -> list[str]:
    """List the names of the views in both folders.

    Raises
    ------
    UserError
        There are none.
    """
    names = [name for name in prediction.files if name in truth.files]
    if not names:
        raise UserError(
            f"No map in {prediction.maps} ({listed(list(prediction.files), 3)}) has the name of one in "
            f"{truth.maps} ({listed(list(truth.files), 3)}); expected the same names, whatever the extension."
        )
    return names


def _pair(
    name: str, prediction: AlbedoFolder, truth: AlbedoFolder
) -> tuple[JudgedView, np.ndarray, np.ndarray | None]:
    """Read one view of both folders, the prediction's mask, and the truth's."""
    albedo, true_albedo = prediction.albedo(name), truth.albedo(name)
    check_size(name, "prediction", albedo, true_albedo)
    own, true_mask = prediction.mask(name), truth.mask(name)
    own = np.ones(albedo.shape[:2], bool) if own is None else own
    check_size(name, "prediction's mask", own, true_albedo)
    judged = own
    if true_mask is not None:
        check_size(name, "truth's mask", true_mask, true_albedo)
        judged = own & true_mask
    maps = (truth.part_map(name), truth.true_shading(name))
    return judge_view(name, albedo, true_albedo, judged, *maps), own, true_mask


def _notes(prediction: AlbedoFolder, truth: AlbedoFolder, views: list[JudgedView]) -> tuple[str, ...]:
    notes = []
    if prediction.masks is None:
        where = "every pixel" if truth.masks is None else "every pixel of the truth's masks"
        notes.append(f"the prediction has no masks: {where} is judged")
    if truth.masks is None:
        black = sum(int((view.truth[view.judged] == 0).all(axis=1).sum()) for view in views)
        notes.append(
            "the truth has no masks: coverage is not known"
            + (f", and {black} judged pixels have no true albedo at all (background?)" if black else "")
        )
    if not truth.part_names:
        notes.append("the truth names no parts of uniform albedo: no variance, no leak")
    elif truth.shading is None:
        notes.append("the truth has no shading: no leak")
    return tuple(notes)
