"""Training of the models that choose the parts (mam_pipeline.parts)."""
