"""A planted fault is one small change of the product, found again where lines have moved."""

from __future__ import annotations

import pytest

from tools.fault_sites import Site, faulty, sites_of

SOURCE = """
class Till:
    rate: "1 + 1" = 2.5

    def change(self, paid: int, coins=()) -> int:
        '''Takes 1 and gives 2.'''
        if not coins:
            raise ValueError(f"{paid - 1} is 1 too few")
        return paid - 1 if paid > 3 else "no" + "ne"


if __name__ == "__main__":
    Till().change(1)
"""


@pytest.mark.parametrize(
    ("within", "kind", "ordinal", "before", "after"),
    [
        ("Till", "constant", 0, "= 2.5", "= (4.75)"),
        ("Till.change", "not", 0, "if not coins:", "if (coins):"),
        ("Till.change", "comparison", 0, "if paid > 3 else", "if (paid <= 3) else"),
        ("Till.change", "arithmetic", 0, "return paid - 1 if", "return (paid + 1) if"),
        ("Till.change", "constant", 0, "paid > 3", "paid > (4)"),
        ("Till.change", "return", 0, 'return paid - 1 if paid > 3 else "no" + "ne"', "return"),
    ],
)
def test_a_fault_is_one_change(
    within: str, kind: str, ordinal: int, before: str, after: str
) -> None:
    site = Site("till.py", within, kind, ordinal)
    assert site in set(sites_of("till.py", SOURCE))
    for text in (SOURCE, f"import ast\n{SOURCE}"):
        assert faulty(text, site)[0] == text.replace(before, after)


def test_messages_hints_and_what_starts_a_module_are_sound() -> None:
    found = [(site.within, site.kind) for site in sites_of("till.py", SOURCE)]
    assert sorted(found) == sorted(
        [
            ("Till", "constant"),
            *(("Till.change", kind) for kind in ("not", "not", "comparison", "arithmetic")),
            *[("Till.change", "constant")] * 2,
            ("Till.change", "return"),
        ]
    )
