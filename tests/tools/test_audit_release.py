"""The meaning of an audit for a release: a weakness stops it, a service not reached does not."""

from __future__ import annotations

import json

import pytest

from tools.audit_release import NOT_REACHED, of_page, of_python

CLEAN = {"name": "numpy", "version": "2.4", "vulns": []}
WEAK = {"name": "pillow", "version": "1.0", "vulns": [{"id": "CVE-2026-1", "fix_versions": []}]}
SKIPPED = {"name": "scipy", "skip_reason": "not found on PyPI"}
PROXY = "requests.exceptions.ProxyError: HTTPSConnectionPool(host='x'): Max retries exceeded"
REFUSED = "npm warn audit 405\nnpm error audit endpoint returned an error\nnpm error A log\n"


@pytest.mark.parametrize(
    ("packages", "text", "may_go_on"),
    [
        ([CLEAN], "1 packages, no known weakness", True),
        ([CLEAN, WEAK], "weak: pillow 1.0 (CVE-2026-1)", False),
        ([SKIPPED, WEAK], "weak: pillow 1.0 (CVE-2026-1)", False),
        ([CLEAN, SKIPPED], "cannot be judged: scipy", False),
        ([SKIPPED], NOT_REACHED, True),
        ([], "cannot be judged: no package", False),
    ],
)
def test_python_packages(packages: list[dict[str, object]], text: str, may_go_on: bool) -> None:
    assert of_python(json.dumps({"dependencies": packages}), "") == (text, may_go_on)


def test_no_connection_is_no_weakness_but_no_answer_is_not_understood() -> None:
    assert of_python("", PROXY) == (NOT_REACHED, True)
    assert of_python("", "a\nERROR: no hash for x\n") == (
        "cannot be judged: ERROR: no hash for x", False
    )  # fmt: skip
    assert of_python("", "") == ("cannot be judged: no answer", False)


def test_the_page() -> None:
    known = {"metadata": {"dependencies": {"total": 9}}, "vulnerabilities": {}}
    weak = {**known, "vulnerabilities": {"preact": {"severity": "high"}}}
    assert of_page(json.dumps(known), "") == ("9 packages, no known weakness", True)
    assert of_page(json.dumps(weak), "") == ("weak: preact (high)", False)
    assert of_page('{"message": "405", "error": {}}', REFUSED) == (NOT_REACHED, True)
    assert of_page('{"error": {"code": "ENOLOCK"}}', "npm error code ENOLOCK\n") == (
        "cannot be judged: npm error code ENOLOCK", False
    )  # fmt: skip
