"""Bodies, figures and pages, as reports, predictions and exports show them."""
