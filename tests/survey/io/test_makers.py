"""Exports of receivers and programs of several makers are read as points, each in its own spelling."""

from pathlib import Path

import pytest

from survey import InputError
from survey.scoring import Checkpoints

EXPORTS = {
    "Trimble": "Point ID,Northing (Meter),Easting (Meter),Elevation (Meter),Feature Code,H Prec (Obs),V Prec (Obs)\n"
    "A1,6700200.45,500100.12,812.33,GCP,0.009,0.015\n",
    "Topcon": "Name,Grid Northing (m),Grid Easting (m),Elevation (m),Code,HRMS(m),VRMS(m)\n"
    "A1,6700200.45,500100.12,812.33,GCP,0.009,0.015\n",
    "Leica": "Point Id;Easting [m];Northing [m];Ortho. Height [m];CQ 2D [m];CQ 1D [m]\n"
    "A1;500100,12;6700200,45;812,33;0,008;0,015\n",
    "Leica in millimetres": "Point Id;Easting [m];Northing [m];Ortho. Height [m];CQ 1D [mm]\n"
    "A1;500100,12;6700200,45;812,33;15\n",
    "FieldGenius": "Point,North,East,Elev,Desc,H SD,V SD\nA1,6700200.45,500100.12,812.33,GCP,0.01,0.015\n",
    "Norwegian": "Punkt;Øst;Nord;Høyde;SDV\nA1;500100,12;6700200,45;812,33;0,015\n",
    "French": "Point;X;Y;Z;Précision Z\nA1;500100,12;6700200,45;812,33;0,015\n",
    "aligned by blanks": "Point    Easting     Northing     Elevation  SDV\n"
    "A1       500100.12   6700200.45   812.33     0.015\n",
    "blanks and decimal commas": "Point Easting Northing Elevation SDV\nA1 500100,12 6700200,45 812,33 0,015\n",
}


@pytest.mark.parametrize("maker", EXPORTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
def test_exports_of_several_makers_give_the_same_point(tmp_path: Path, maker: str, encoding: str) -> None:
    (tmp_path / "export.txt").write_text(EXPORTS[maker], encoding=encoding)
    points = Checkpoints.read(tmp_path / "export.txt", crs="EPSG:32608")
    assert points.xyz.tolist() == [[500100.12, 6700200.45, 812.33]]
    assert points.sigma_z_m.tolist() == [0.015]
    assert points.names == ("A1",)


def test_both_heights_of_a_receiver_are_refused_until_one_is_chosen(tmp_path: Path) -> None:
    export = (
        "Name,Easting,Northing,Elevation,Longitude,Latitude,Ellipsoidal height,Easting RMS,Elevation RMS,Lateral RMS\n"
        "A1,500100.12,6700200.45,812.33,-134.998,60.438,820.33,0.01,0.018,0.015\n"
    )
    (tmp_path / "emlid.csv").write_text(export)
    with pytest.raises(InputError, match="columns Elevation and Ellipsoidal height, and either could be"):
        Checkpoints.read(tmp_path / "emlid.csv", crs="EPSG:32608")
    points = Checkpoints.read(tmp_path / "emlid.csv", crs="EPSG:32608", columns={"z_m": "Elevation"})
    assert points.xyz[0, 2] == 812.33
    assert points.sigma_z_m[0] == 0.018


def test_lines_before_the_header_are_refused_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Project: glacier\nPoint,Easting,Northing,Elevation\nA1,1.0,2.0,3.0\n")
    with pytest.raises(InputError, match="header names 2; remove lines before"):
        Checkpoints.read(tmp_path / "a.csv", crs="EPSG:32608", sigma_m=0.1)
