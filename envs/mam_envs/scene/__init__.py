"""The simulated scene: the object, what stands around it, randomisation, contacts, pictures."""
