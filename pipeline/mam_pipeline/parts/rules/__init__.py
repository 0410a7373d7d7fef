"""Hand rules of the parts stage, one concern a file; their switches are in `mam_pipeline.rules`."""
