"""For all tests."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

# A busy machine is no fault of what is tested: hypothesis' own limits are 200 ms an example and a minute to make them.
settings.register_profile("scenegate", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("scenegate")
