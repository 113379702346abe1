from dataclasses import replace

import pytest

from device.preview.contract import Description, file_name, parse, tile_name
from shared import CfaPattern
from shared.errors import InputError

DESCRIPTION = Description("BWG/WWW/GWR", "RGB", 1, False, (5, 6, 7, 8), "1")


@pytest.mark.parametrize("description", [DESCRIPTION, replace(DESCRIPTION, scale=3, linear=True, channels="GRB", builder="17")])
def test_metadata_come_back(description: Description) -> None:
    assert parse(description.to_metadata()) == description


def test_another_model_is_none_of_ours() -> None:
    with pytest.raises(InputError, match="no preview graph of Panchroma"):
        parse({"author": "somebody"})


def test_another_contract_is_named_with_ours() -> None:
    with pytest.raises(InputError, match="contract 7, this program 1"):
        parse({**DESCRIPTION.to_metadata(), "panchroma.contract": "7"})


@pytest.mark.parametrize("broken", [{"panchroma.halo": "1 2 3"}, {"panchroma.scale": "one"}])
def test_damage_is_said(broken: dict[str, str]) -> None:
    with pytest.raises(InputError, match="description is damaged"):
        parse({**DESCRIPTION.to_metadata(), **broken})


@pytest.mark.parametrize("name", ["tile", "channels", "scale", "output", "halo", "builder"])
def test_everything_must_be_there(name: str) -> None:
    metadata = DESCRIPTION.to_metadata()
    del metadata[f"panchroma.{name}"]
    with pytest.raises(InputError, match=f"description is damaged.*{name}"):
        parse(metadata)


def test_a_mismatch_names_both_values() -> None:
    with pytest.raises(InputError, match=r"pattern BWG/WWW/GWR, the mosaic has RWG/WWW/GWB"):
        DESCRIPTION.check(CfaPattern.bayer(3, "BGGR"))
    with pytest.raises(InputError, match="channels RGB, the mosaic has BGR"):
        DESCRIPTION.check(CfaPattern(CfaPattern.bayer(3).tile, channels="BGR"))
    DESCRIPTION.check(CfaPattern.bayer(3, origin=(2, 1)))


def test_the_tile_is_named_from_the_middle_of_the_block() -> None:
    assert {tile_name(CfaPattern.bayer(4, "GBRG", (row, column))) for row in range(4) for column in range(4)} == {
        "GWWR/WWWW/WWWW/BWWG"
    }


def test_file_names() -> None:
    assert file_name(CfaPattern.bayer(6, origin=(3, 4)), 1, linear=False) == "rggb-k6-s1.onnx"
    assert file_name(CfaPattern.bayer(8, "BGGR"), 4, linear=True) == "bggr-k8-s4-linear.onnx"
    assert file_name(CfaPattern.with_block(("RGC", "YWM"), 8), 1, linear=False) == "rgcywm-k8-s1.onnx"
