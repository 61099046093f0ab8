"""A synthetic rc_visard: image sets over gRPC, parameters over REST, on whatever scene it is given."""
