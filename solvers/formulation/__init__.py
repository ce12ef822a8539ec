"""What is solved for what is asked: models, plants, end conditions, corners and peaks made a problem."""
