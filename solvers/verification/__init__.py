"""The control flown on the original model, by means that know nothing of the method."""
