"""Tables, figures and pages of a run: the stage `report`."""
