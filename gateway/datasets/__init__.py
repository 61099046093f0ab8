"""Pictures of many scenes from many cameras as a dataset, by the cores of this machine or of a Ray cluster."""
