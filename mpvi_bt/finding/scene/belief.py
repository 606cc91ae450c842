"""Probability of a thing at its seen place: Bayes' rule with a detector's rates."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Belief:
    """How looks raise and lower the probability that a thing is at a place.

    Our choice: the odds are multiplied by the likelihood ratio of each look. A detection of score s counts as
    hit / (1 - s), the false alarms kept to `least_false`..`most_false`, a look that should show the thing and does not
    as (1 - hit) / (1 - `least_false`). With the numbers below one detection is enough (0.5) if its score is 0.78 or
    more, two of any score are, and what was seen often is given up after three looks in vain.
    """

    hit: float = 0.9  # share of the things in plain view that the detector finds
    prior: float = 0.2  # probability at the first detection, before its score counts
    given_up: float = 0.1  # a thing less likely than this is forgotten
    sure: float = 0.98  # largest probability, so that a few looks in vain always suffice to give up
    most_false: float = 0.25  # false alarms of detections with a low score
    least_false: float = 0.05  # false alarms of detections with a high score

    def first(self, score: float) -> float:
        """Probability of a thing that was detected once."""
        return self.seen(self.prior, score)

    def seen(self, before: float, score: float) -> float:
        """Probability after another detection, from what it was before."""
        return _updated(before, self.hit / min(max(1.0 - score, self.least_false), self.most_false), self.sure)

    def missed(self, before: float) -> float:
        """Probability after a look that should have shown it and did not."""
        return _updated(before, (1.0 - self.hit) / (1.0 - self.least_false), self.sure)


BELIEF = Belief()


def _updated(before: float, ratio: float, sure: float) -> float:
    odds = before / max(1.0 - before, 1e-9) * ratio
    return min(odds / (1.0 + odds), sure)
