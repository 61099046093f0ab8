"""Names of the parts of realism."""

import pytest

from renderers.stereo.realism import REALISM_PARTS, parse_realism


def test_names_of_parts() -> None:
    assert parse_realism("off") == ()
    assert parse_realism("all") == REALISM_PARTS
    assert parse_realism("vignetting, shadows") == ("shadows", "vignetting")
    with pytest.raises(ValueError, match="'haze' is not a part; use 'off', 'all' or some of shadows, lens-blur"):
        parse_realism("shadows,haze")
    with pytest.raises(ValueError, match="'all' cannot be combined with other names"):
        parse_realism("shadows,all")
