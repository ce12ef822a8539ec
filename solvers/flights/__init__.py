"""Many flights of one answer at once, whose parameters, starts and actuators are not as assumed."""
