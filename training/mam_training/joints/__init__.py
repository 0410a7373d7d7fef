"""Training of the model that ranks joint hypotheses (mam_pipeline.joints)."""
