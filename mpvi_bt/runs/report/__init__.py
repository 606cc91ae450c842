"""A suite's results as figures, plots and pages."""
