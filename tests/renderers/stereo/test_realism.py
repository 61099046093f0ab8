"""Names of the parts of realism."""

import pytest

from renderers.stereo.realism import REALISM_PARTS, parse_realism


def test_names_of_parts() -> None:
    assert parse_realism("off") == ()
    assert parse_realism("all") == REALISM_PARTS
    assert parse_realism("vignetting, shadows") == ("shadows", "vignetting")
    for text, named in (("shadows,haze", "'haze' .* 'off', 'all' .* shadows, lens-blur"), ("shadows,all", "'all'")):
        with pytest.raises(ValueError, match=named):
            parse_realism(text)
