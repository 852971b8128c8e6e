"""Files that hold secrets."""

from __future__ import annotations

import pytest

from robotctl.web.access import Role
from robotctl.web.secret_files import tokens_of


def test_tokens_are_kept_for_their_user_alone_and_made_once(tmp_path):
    tokens = tokens_of(tmp_path)
    assert tokens_of(tmp_path) == tokens
    assert len(set(tokens.values())) == len(Role)
    (file,) = tmp_path.iterdir()
    assert file.stat().st_mode & 0o777 == 0o600
    file.chmod(0o644)
    with pytest.raises(Exception, match="open to others"):
        tokens_of(tmp_path)
