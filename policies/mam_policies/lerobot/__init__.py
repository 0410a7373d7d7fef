"""The bridge to LeRobot: datasets, policies, joint mapping, training, export."""
