"""The studio: look at an object in the browser, and put right what the engine got wrong."""
