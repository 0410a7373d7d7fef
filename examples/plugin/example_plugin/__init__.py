"""An example plug-in of mam-sim: a robot (arm), a task (task) and a segmenter (segmenter)."""
