"""Differences of our responses from Director's, each with its reason; everything else must be equal.

``bad.log`` and ``cpp_wrapper.log`` by number of the event; ``fuzz.log`` differs in one rule (see ``test_replay``).
"""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Difference:
    """Our response where it differs from Director's."""

    status: int | None
    """None: no response, as in Director; the message is counted as undecodable."""
    says: str
    """Part of our error or warning; empty: there is none."""
    why: str
    paths: list[Any] | None = None
    """added_geometries or set_transforms of the response; None: empty."""


SILENT = "Director sends nothing when it fails; we say what is wrong"
LENIENT = "tolerated: the meaning is plain, and a negative status would end the handler of Director's Python client"
CRASH = "Director dies"
UNDECODABLE = "nobody can be answered"


def _reason(text: str) -> Difference:
    return Difference(-3, text, SILENT)


BAD: dict[int, Difference] = {
    8: _reason("not valid JSON"),
    9: _reason("not valid JSON"),
    10: _reason("not valid JSON"),
    11: _reason("invalid start byte at byte 0"),
    12: Difference(0, "", "a null body is an empty request; Director's answer lacks the four lists by accident"),
    13: _reason("must be a JSON object, not []"),
    14: _reason("must be a JSON object, not 1"),
    15: _reason('must be a JSON object, not "x"'),
    16: Difference(0, 'unknown fields "a"', LENIENT),
    17: _reason("not valid JSON"),
    18: _reason("not valid JSON"),
    19: Difference(0, "", LENIENT),
    20: Difference(0, "", LENIENT),
    21: Difference(0, "", LENIENT),
    23: Difference(0, "", LENIENT),
    24: _reason("delete must be a list of commands, not false"),
    25: Difference(0, "", LENIENT + " (an old Drake client sends null for shapes it does not know)"),
    26: _reason("a command must be an object, not []"),
    27: Difference(0, "", LENIENT + " (the document's own example has a bare command)", [["ok"]]),
    28: _reason('geometry.type "cone" is not supported'),
    29: _reason("geometry.type is missing"),
    30: _reason("geometries is missing"),
    31: _reason("geometry must be an object, not []"),
    32: _reason("geometry.lengths is missing"),
    33: _reason("geometry.lengths has 2 numbers, not 3"),
    34: _reason('geometry.lengths must be a number, not "abc"'),
    35: _reason("geometry.radius is missing"),
    36: _reason("geometry.radius is missing"),
    37: _reason('geometry.radius must be a number, not "1"'),
    38: Difference(0, "", LENIENT + ": three colour components are opaque", [["bad", "38"]]),
    39: Difference(0, "", LENIENT, [["bad", "39"]]),
    40: _reason('geometry.color must be a list of 4 numbers, not "red"'),
    41: Difference(0, "", LENIENT, [["bad", "41"]]),
    42: _reason("geometry.transform.translation has 2 numbers, not 3"),
    44: Difference(-3, "faces has 9 in row 0, but there are 3 vertices", CRASH),
    45: _reason("faces has rows of 2, not rows of 3 numbers"),
    47: Difference(-3, "faces has -1 in row 0, but there are 3 vertices", CRASH),
    48: Difference(-3, "points has rows of 2", "Director accepts points of two numbers and draws nothing"),
    49: Difference(0, "", "a C++ client sends empty channels; they count as absent", [["bad", "49"]]),
    50: Difference(0, "1 values for 4 points", "as an empty channel, with a warning", [["bad", "50"]]),
    51: _reason("points has 2 numbers in row 1"),
    53: Difference(0, "", "Director's rounding adds an angle; ours cannot", [["bad", "53"]]),
    54: Difference(0, "", "Director divides by the step", [["bad", "54"]]),
    55: _reason("angle_start is missing"),
    61: _reason("filename is missing"),
    62: Difference(-3, "lies outside", "only files below the folders that the operator opened are looked at"),
    63: Difference(-3, "lies outside", "as above"),
    64: Difference(0, "", "the document says scale is a number; Director only takes lists", [["bad", "64"]]),
    65: Difference(
        0, "there is no package", "a missing file is told, as a warning, and draws nothing", [["bad", "65"]]
    ),
    66: Difference(-3, 'geometry.type "cone"', "the good commands of the message are carried out", [["p1"], ["p3"]]),
    67: _reason("path is missing"),
    68: _reason("path must be a list of strings, not null"),
    69: Difference(0, "", 'a path given as a string is split at "/", not into characters', [["a", "b"]]),
    70: _reason("geometries is missing"),
    71: Difference(-3, "path must be a list of strings", "Director iterates over the keys of an object"),
    72: _reason("transform is missing"),
    73: _reason("path is missing"),
    74: _reason("transform.translation has 2 numbers, not 3"),
    75: _reason("transform.quaternion has 2 numbers, not 4"),
    76: _reason("transform must be an object"),
    78: _reason("path is missing"),
    79: _reason('a command must be an object, not ["ok2"]'),
    80: _reason("path must be a list of strings, not null"),
    81: _reason('a command must be an object, not "ok2"'),
    82: Difference(None, "fingerprint", UNDECODABLE),
    83: Difference(None, "within its header", UNDECODABLE),
    84: Difference(None, "0 bytes", UNDECODABLE),
    85: Difference(None, "8 bytes", UNDECODABLE),
    86: _reason("not valid JSON"),
}

CPP_WRAPPER: dict[int, Difference] = {
    5: Difference(0, "", 'a cloud with "rgb": [] is drawn in its colour', [["cpp", "cloud_no_colour"]]),
    6: Difference(0, "", 'a cloud with "rgb": [] is drawn in its colour', [["cpp", "cloud_bad_colour"]]),
}

GEOMS: dict[int, Difference] = {
    29: Difference(-3, "lies outside", "only files below the folders that the operator opened are looked at")
}

NAN = {
    3: Difference(
        0, "points are NaN, infinite or too far", "a warning tells which points a line lacks", [["cam", "line"]]
    ),
    5: Difference(0, "transform is not finite", "a warning tells why nothing is drawn", [["cam"]]),
}

DIFFERENCES: dict[str, dict[int, Difference]] = {"bad": BAD, "cpp_wrapper": CPP_WRAPPER, "geoms": GEOMS, "nan": NAN}
