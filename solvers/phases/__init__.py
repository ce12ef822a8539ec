"""A flight of phases: problems that are solved as one, each beginning where the one before ends."""
