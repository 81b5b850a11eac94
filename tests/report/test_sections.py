"""The tables of a page: which frames they list."""

from cadtof_cli.report.sections import LISTED_FAILURES, FrameLine, PageText, failures, frame_table


def test_of_thousands_of_failed_frames_the_first_are_listed() -> None:
    lost = [FrameLine(f"lost {number}", "failed", "no light") for number in range(2000)]
    page = PageText("run", "", frames=(FrameLine("whole", "ok", number=0), *lost))
    for markup in (failures(page), frame_table(page)):
        assert str(markup).count("no light") == LISTED_FAILURES
        assert "lost 499<" in str(markup)
        assert "lost 500<" not in str(markup)
    assert "2000 failed, 0 skipped; the first 500 of them" in str(failures(page))
    assert "501 of 2001 frames" in str(frame_table(page))
