"""An example plug-in of mam-sim: a robot, a task, a segmenter and an algorithm."""
