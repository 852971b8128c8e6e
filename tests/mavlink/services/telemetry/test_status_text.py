"""Notices as texts in chunks."""

from robotctl.messages.control import (
    Notice,
)


def test_long_notices_go_out_in_chunks_that_the_definition_asks_for(bench):
    text = "".join(chr(ord("a") + i % 26) for i in range(100))
    bench.step(Notice(0, 3, "short"), Notice(0, 4, text), Notice(0, 99, "\u00e9"))
    sent = bench.messages("STATUSTEXT")
    assert [(m.severity, m.text, m.chunk_seq) for m in sent] == [
        (3, "short", 0),
        (4, text[:50], 0),
        (4, text[50:], 1),
        (4, "", 2),  # 100 is a multiple of 50: an empty chunk ends the text
        (7, "?", 0),
    ]
    assert sent[0].id == 0
    assert {m.id for m in sent[1:4]} == {sent[1].id} != {0}


def test_a_flood_of_notices_is_spread_and_the_oldest_are_dropped(bench):
    bench.step(*[Notice(0, 6, str(number)) for number in range(200)])
    assert len(bench.texts()) == 4
    bench.run(1.0)
    assert bench.texts()[-1] == "199"
