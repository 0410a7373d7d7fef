"""Training of the models that read photographs (mam_pipeline.photo)."""
