"""Classes generated from protos/ and lcmtypes/ (`make generate`); do not edit them."""
