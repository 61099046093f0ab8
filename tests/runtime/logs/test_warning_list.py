from gateway.runtime.logs.warning_list import MAX_LISTED, MAX_SUBJECTS, WarningList


def test_the_newest_warnings_of_each_subject_are_listed() -> None:
    warnings = WarningList()
    warnings.set("a", "one", "two")
    warnings.set("b", "three")
    warnings.set("a", "four")
    assert warnings.listed() == ["four", "three"]
    warnings.set("a")
    assert warnings.listed() == ["three"]
    warnings.remove(lambda subject: subject == "b")
    assert not warnings.sentences


def test_equal_sentences_are_listed_once_and_many_are_counted() -> None:
    warnings = WarningList()
    for number in range(MAX_SUBJECTS + 5):
        warnings.set(number, f"sentence {number}")
    warnings.set("again", f"sentence {MAX_SUBJECTS}")
    listed = warnings.listed()
    assert len(listed) == MAX_LISTED + 1
    assert listed[:2] == [f"sentence {MAX_SUBJECTS}", f"sentence {MAX_SUBJECTS + 4}"]
    assert listed[-1] == f"and {MAX_SUBJECTS - 1 - MAX_LISTED} more"


def test_one_subject_keeps_a_limited_number_of_sentences() -> None:
    warnings = WarningList()
    warnings.set("a", *(f"sentence {number}" for number in range(10_000)))
    shown = MAX_LISTED - 1
    assert warnings.listed() == [*(f"sentence {number}" for number in range(shown)), f"and {10_000 - shown} more"]
