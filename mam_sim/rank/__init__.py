"""The public measure: does a robot succeed on the joints of an asset, ours or anybody's."""
