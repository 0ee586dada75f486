"""What trial.toml may say."""

import tomllib

import pytest

from rangeeval.errors import SettingsError
from rangeeval.model.settings import settings_from

CONTRACT = """
[trial]
name = "Inbound pass 3"
date = 2026-05-14
radar = "MFR-1"
handling = "UNCLASSIFIED"
[site]
latitude_deg = 36.42
longitude_deg = 127.39
height_m = 110.0
heading_deg = 30.0
tilt_deg = 15.0
[radar]
bandwidth_hz = 2.0e6
beamwidth_elevation_deg = 1.8
beamwidth_azimuth_deg = 1.7
monopulse_slope = 1.6
update_interval_s = 0.5
[attitude]
radius_upper_m = 5.0
radius_lower_m = 2.0
gravity_m_s2 = 9.80665
[bins]
variable = "range"
width = 5000.0
start = 0.0
min_samples = 30
[[requirements]]
quantity = "range_sigma"
limit = 20
confidence = 0.95
when = { snr_db_min = 20.0 }
[[logs]]
file = "legacy/ES_0514.txt"
kind = "residuals"
delimiter = ";"
decimal = ","
skip_rows = 12
columns = { "T(s)" = "time_s", "ES_R(ft)" = "range_residual_ft" }
"""


def test_the_contracts_own_example_is_read():
    """Every key of the contract's example arrives, dates as text, whole numbers as numbers."""
    s = settings_from(tomllib.loads(CONTRACT))
    assert s.trial.date == "2026-05-14"
    assert s.requirements[0].limit == 20.0
    assert s.requirements[0].when == {"snr_db_min": 20.0}
    assert s.logs[0].columns["ES_R(ft)"] == "range_residual_ft"
    assert s.radar.bandwidth_hz == 2.0e6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[bins]\nwidht = 1.0", "unknown key 'widht'; did you mean 'width'?"),
        ("[trail]\nname = 'x'", "unknown key 'trail'; did you mean 'trial'?"),
        ("[bins]\nwidth = 'wide'", "bins.width: is 'wide', expected a number"),
        ("[bins]\nwidth = true", "expected a number"),
        ("[bins]\nwidth = 0.0", "bins.width is 0, expected more than 0"),
        ("[bins]\nwidth = nan", "expected a finite number"),
        ("[bins]\nvariable = 'azimuth'", "bins.width is missing: bins of azimuth have no usual width, give it in rad"),
        ("[bins]\nvariable = 'rnage'", "did you mean 'range'?"),
        ("[[requirements]]\nquantity = 'range_sigma'", "the key 'limit' is missing"),
        ("[[requirements]]\nquantity = 'q'\nlimit = 1.0\nconfidence = 95.0", "confidence is 95"),
        ("[[requirements]]\nquantity = 'q'\nlimit = 1.0\nwhen = { snr = 3.0 }", "ends neither in _min nor in _max"),
        ("[[logs]]\nfile = 'a'\nkind = 'residual'", "did you mean 'residuals'?"),
        ("[[logs]]\nfile = 'a'\ndecimal = ';'", "decimal"),
        ("[radar]\nbandwidth_hz = -1.0", "radar.bandwidth_hz is -1"),
        ("bins = 3", "expected a table"),
        ("requirements = 3", "expected an array of tables"),
    ],
)
def test_a_wrong_setting_is_one_line_that_names_the_key(text, message):
    """Where, what was found, what was expected."""
    with pytest.raises(SettingsError) as caught:
        settings_from(tomllib.loads(text), "pass3/trial.toml")
    assert message in str(caught.value)
    assert str(caught.value).startswith("pass3/trial.toml")
    assert "\n" not in str(caught.value)
