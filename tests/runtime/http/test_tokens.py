from pathlib import Path

import pytest

from gateway.runtime.http.tokens import COOKIE_SECONDS, TokenError, Tokens, read_tokens

ONE, TWO = "0123456789abcdef", "fedcba9876543210"


def test_accepts_each_of_several_tokens_only() -> None:
    tokens = Tokens(ONE, TWO)
    assert tokens.accept(ONE)
    assert tokens.accept_header(f"Bearer {TWO}")
    assert tokens.accept_header(f"bearer  {TWO} ")
    for wrong in ("", ONE[:-1], ONE + "0", "x" * 5000, "\udcff", "é"):
        assert not tokens.accept(wrong)
        assert not tokens.accept_header(f"Bearer {wrong}")
    assert not tokens.accept_header(ONE)
    assert not tokens.accept_header(f"Basic {ONE}")


def test_repr_hides_tokens() -> None:
    tokens = Tokens(ONE, TWO)
    assert ONE not in repr(tokens)
    assert ONE not in tokens.cookie(ONE, 0.0)


def test_cookie_is_valid_with_its_token_until_it_expires() -> None:
    now = 1.7e9
    for token in (ONE, TWO):
        cookie = Tokens.cookie(token, now)
        assert Tokens(ONE, TWO).accept_cookie(cookie, now)
        assert Tokens(token).accept_cookie(cookie, now + COOKIE_SECONDS - 1)
        assert not Tokens(token).accept_cookie(cookie, now + COOKIE_SECONDS)
        assert not Tokens(TWO if token == ONE else ONE).accept_cookie(cookie, now)
        end, _, signature = cookie.partition(".")
        for wrong in (f"{int(end) + 1}.{signature}", f"0{end}.{signature}", f"{end}.", end, signature, f".{signature}"):
            assert not Tokens(ONE, TWO).accept_cookie(wrong, now), wrong


@pytest.mark.parametrize("wrong", ["", ONE, ".", "-1.x", "x" * 5000, "9" * 1000 + ".x", "\udcff", "²." + "0" * 64, "é"])
def test_invalid_cookies_are_refused(wrong: str) -> None:
    assert not Tokens(ONE, TWO).accept_cookie(wrong, 0.0)


def test_token_file_has_one_token_per_line(tmp_path: Path) -> None:
    path = tmp_path / "tokens"
    path.write_text(f"# the old one goes in May\n{ONE}\n\n  {TWO}  \n")
    tokens = read_tokens(path)
    assert tokens.accept(ONE)
    assert tokens.accept(TWO)
    assert not tokens.accept("# the old one goes in May")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "has no token"),
        (b"# nothing\n", "has no token"),
        (b"short\n", "Token 1 of the token file"),
        (b"0123456789abcdef\nwith spaces in the middle", "Token 2 of the token file"),
        ("pässword-pässword".encode(), "not ASCII"),
    ],
)
def test_errors_about_token_files_do_not_quote_them(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "tokens"
    path.write_bytes(content)
    with pytest.raises(TokenError, match=says) as caught:
        read_tokens(path)
    assert "0123456789abcdef" not in str(caught.value)
    assert "spaces in the middle" not in str(caught.value)


def test_missing_token_file(tmp_path: Path) -> None:
    with pytest.raises(TokenError, match="cannot be read: No such file"):
        read_tokens(tmp_path / "nowhere")
