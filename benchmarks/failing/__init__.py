"""What monitors, interventions and latency do to q: the study of docs/failing_measured.md."""
