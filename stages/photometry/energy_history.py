"""`energy.json`: the energy after every alternation, so that a reader can check its descent."""

from __future__ import annotations

from typing import Any

from stages.photometry.joint.fast_alternation import FastDescent, Settled
from stages.photometry.joint.stopping_rule import Round
from stages.photometry.paper.alternation import AlternationRecord, Descent, Outcome
from stages.photometry.paper.energy import EnergyTerms, EnergyWeights

UNDER_LIGHT = {
    "outcome": "of albedo_tv and albedo together: converged if both did",
    "energy": "Eq. 2 of albedo_tv under the light of the stage before, without a gauge",
    "gap": "upper bound of its excess over the least energy, relative to it, all channels together",
    "clusters": "energies of each with its margin: what clusters share counts in each",
}
LEGEND = {
    "energy": "Eq. 2 in the gauge (sum of |albedo| = sum of |image| in each channel)",
    "photo, smooth, multi_view": "the sums of Eq. 3, 4 and 5 in the gauge, before lambda and mu",
    "smoothed": (
        "Eq. 2 with the smoothed absolute value, whose descent reweighting guarantees: before the "
        "alternation, after the light step, after the albedo step, before the gauge is reapplied; it never "
        "rises"
    ),
    "gap": (
        "solver: fast: upper bound of the excess over the least energy under the same light, all channels "
        "together, relative to the energy"
    ),
    "gauge_scale": "factor that then brought the albedo back into the gauge",
}


def descent_as_json(descent: Descent) -> dict[str, Any]:
    """Convert one channel's history to JSON values, without timings: the same run gives the same text."""
    return {
        "outcome": descent.outcome.name.lower() if descent.outcome else "unfinished",
        "outcome_text": descent.outcome.value if descent.outcome else "",
        "start_energy": descent.start_energy,
        "alternations": [_record_as_json(k, record) for k, record in enumerate(descent.history, start=1)],
    }


def rounds_as_json(descent: FastDescent, weights: EnergyWeights) -> list[dict[str, Any]]:
    """Convert the history of `solver: fast` to JSON values, per channel: an entry per evaluation."""
    return [
        {
            "outcome": descent.outcome.name.lower(),
            "outcome_text": descent.outcome.value,
            "alternations": [
                *(_round_as_json(one, channel) for one in descent.rounds[:-1]),
                {
                    **_round_as_json(descent.rounds[-1], channel),
                    "energy": terms.total(weights),
                    **_terms_as_json(terms),
                },
            ],
        }
        for channel, terms in enumerate(descent.terms)
    ]


def rounds_under_light_as_json(descent: Settled, outcome: Outcome) -> list[dict[str, Any]]:
    """Convert the history of an albedo under a fixed light: energies are Eq. 2 without a gauge.

    The outcome is that of all albedos under the light.
    """
    return [
        {
            "outcome": outcome.name.lower(),
            "outcome_text": outcome.value,
            "alternations": [_round_as_json(one, channel) for one in descent.rounds],
        }
        for channel in range(3)
    ]


def _round_as_json(one: Round, channel: int) -> dict[str, Any]:
    return {"alternation": one.iterations, "energy": one.energy[channel], "gap": one.gap}


def _record_as_json(number: int, record: AlternationRecord) -> dict[str, Any]:
    return {
        "alternation": number,
        "energy": record.energy,
        "relative_change": record.relative_change,
        **_terms_as_json(record.terms),
        "smoothed": {
            "before": record.smoothed_before,
            "after_light": record.smoothed_after_light,
            "after_albedo": record.smoothed_after_albedo,
        },
        "gauge_scale": record.gauge_scale,
        "cg_steps": record.cg_steps,
        "cg_relative_residual": record.cg_relative_residual,
        "cg_reached": record.cg_reached,
    }


def _terms_as_json(terms: EnergyTerms) -> dict[str, float]:
    return {"photo": terms.photo, "smooth": terms.smooth, "multi_view": terms.multi_view}
