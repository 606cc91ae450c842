"""Suites: many episodes, their order, engines and stored results."""
