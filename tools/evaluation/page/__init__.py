"""The evaluation report: one page with verdict, plots, gallery and tables."""
