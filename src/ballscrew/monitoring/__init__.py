"""Has the axis changed, and since when? A history of runs becomes a state, a stage and an alarm."""
