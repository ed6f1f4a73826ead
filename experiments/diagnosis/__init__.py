"""Which strut has failed, how, and since when: from what a controller sends and senses."""
