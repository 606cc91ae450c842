"""Counts of a policy server, and their text for Prometheus."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

BUCKETS_S = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # upper ends


@dataclass
class Metrics:
    """Counts since the server began.

    Attributes:
        clients: Connected now.
        connections: Clients that were let in so far.
        inferences: Observations answered.
        infer_s: Time that the policy took for them, in all [s].
        received_bytes: Of observations.
        sent_bytes: Of answers.
        errors: By kind, as the error frame begins: see docs/serving_policies.md.
    """

    clients: int = 0
    connections: int = 0
    inferences: int = 0
    infer_s: float = 0.0
    received_bytes: int = 0
    sent_bytes: int = 0
    errors: Counter[str] = field(default_factory=Counter)
    _buckets: list[int] = field(default_factory=lambda: [0] * (len(BUCKETS_S) + 1))

    def inferred(self, seconds: float) -> None:
        """Count an answer that took the policy so long."""
        self.inferences += 1
        self.infer_s += seconds
        self._buckets[bisect_left(BUCKETS_S, seconds)] += 1

    def summary(self) -> str:
        """For a person, such as "2 clients (5 so far), 431 answers, 12.3 ms each, 1 error"."""
        errors = sum(self.errors.values())
        each = f", {1000 * self.infer_s / self.inferences:.1f} ms each" if self.inferences else ""
        failed = f", {_counted(errors, 'error')}" if errors else ""
        clients = f"{_counted(self.clients, 'client')} ({self.connections} so far)"
        return f"{clients}, {_counted(self.inferences, 'answer')}{each}{failed}"

    def text(self) -> str:
        """In Prometheus' text format, version 0.0.4."""
        return "".join(f"{line}\n" for line in self._lines())

    def _lines(self) -> Iterator[str]:
        yield from _one("clients", "gauge", "Clients connected now.", self.clients)
        yield from _one("connections_total", "counter", "Clients that were let in.", self.connections)
        yield from _one("received_bytes_total", "counter", "Size of observations.", self.received_bytes)
        yield from _one("sent_bytes_total", "counter", "Size of answers.", self.sent_bytes)
        yield from _head("errors_total", "counter", "Errors told to clients, by kind.")
        yield from (f'mpvi_serve_errors_total{{kind="{kind}"}} {count}' for kind, count in sorted(self.errors.items()))
        yield from _head("infer_seconds", "histogram", "Time that the policy took for one observation.")
        total = 0
        for end, count in zip((*BUCKETS_S, "+Inf"), self._buckets, strict=True):
            total += count
            yield f'mpvi_serve_infer_seconds_bucket{{le="{end}"}} {total}'
        yield f"mpvi_serve_infer_seconds_sum {self.infer_s:.6f}"
        yield f"mpvi_serve_infer_seconds_count {self.inferences}"


def _head(name: str, kind: str, about: str) -> Iterator[str]:
    yield f"# HELP mpvi_serve_{name} {about}"
    yield f"# TYPE mpvi_serve_{name} {kind}"


def _one(name: str, kind: str, about: str, value: int) -> Iterator[str]:
    yield from _head(name, kind, about)
    yield f"mpvi_serve_{name} {value}"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
