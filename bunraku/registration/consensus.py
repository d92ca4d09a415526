"""Which of a person's landmarks to believe: one in the wrong place must not ruin a good fit."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from bunraku.registration.body import Body
from bunraku.registration.search import Registration, register_body
from bunraku.types import Mesh

Landmarks = Mapping[str, Sequence[float]]
AGREES = 0.1  # of the height: how near to the fit without it a landmark is beyond suspicion
COST, COST_IF_POOR = 1.05, 1.15  # by how much the strain must fall for each landmark left out
MOST_TRIALS = 6  # landmarks that are left out one at a time


def register_with_landmarks(
    body: Body, figure: Mesh, landmarks: Landmarks | None, names: Sequence[str]
) -> tuple[Registration, tuple[str, ...]]:
    """Register with those landmarks that the surfaces do not speak against.

    Landmarks near the joints of the fit without any are believed. If some are not, fits without
    each of them, and without them all, compete with the fit to all: the least strain wins, made
    worse by 5 % for each landmark left out, by 15 % where that leaves a poor fit: there a person
    knows better.

    Args:
        body: the source.
        figure: the figure's proxy, in metres.
        landmarks: joint name to its place on the figure.
        names: of the source's joints.

    Returns:
        the best registration, and a warning for each landmark left out.

    Raises:
        ValueError: if a landmark names no joint.
    """
    if not landmarks:
        return register_body(body, figure), ()
    every = register_body(body, figure, landmarks=landmarks, names=names)
    alone = register_body(body, figure)
    away = distances(alone, landmarks, names)
    doubtful = [
        name for name in landmarks if away[name] > AGREES * float(np.ptp(figure.vertices[:, 1]))
    ]
    tried = [(every, frozenset[str]())]
    for left_out in trials(doubtful, away):
        kept = {name: place for name, place in landmarks.items() if name not in left_out}
        fit = register_body(body, figure, landmarks=kept, names=names) if kept else alone
        tried.append((fit, left_out))
    best, rejected = min(tried, key=lambda fit: price(fit[0], len(fit[1])))
    off = distances(best, landmarks, names)
    return best, tuple(
        f"landmark {name!r} was left out: it lies {off[name]:.2f} m from where everything else "
        "has that joint; check its place and its side"
        for name in landmarks
        if name in rejected
    )


def price(fit: Registration, left_out: int) -> float:
    """Make a fit's strain worse for each landmark that it leaves out."""
    return fit.strain * (COST if fit.confidence > 0.5 else COST_IF_POOR) ** left_out


def trials(doubtful: Sequence[str], away: Mapping[str, float]) -> Iterator[frozenset[str]]:
    """Say which landmarks to leave out: all doubtful ones, and each of the most doubtful."""
    if len(doubtful) > 1:
        yield frozenset(doubtful)
    for name in sorted(doubtful, key=lambda one: -away[one])[:MOST_TRIALS]:
        yield frozenset([name])


def distances(
    registration: Registration, landmarks: Landmarks, names: Sequence[str]
) -> dict[str, float]:
    """Measure how far each landmark is from where a registration has its joint, in metres."""
    places = {name: registration.joints[list(names).index(name)] for name in landmarks}
    return {name: float(np.linalg.norm(places[name] - landmarks[name])) for name in landmarks}
