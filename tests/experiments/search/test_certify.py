from dataclasses import replace

import numpy as np
import pytest

import activetouch
from activetouch import TactileSensor
from belief import Probe
from belief.errors import InvalidArgument
from experiments.command_line.arguments import BadArgument
from experiments.search.certify import Certify, TooFewSearches
from experiments.search.run import RunMismatch
from planners import Outcome
from planners.certified import Certificate, NotCertified
from planners.session_log import OtherModel


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("certificate") / "coarse.json"
    return path, activetouch.certify("coarse", risk=0.2, searches=40, max_touches=2, out=path, jobs=1)


def test_a_certificate_is_written_and_says_what_it_is_for(made):
    path, certificate = made
    assert Certificate.load(path) == certificate
    assert "P(wrong | confirmed after k touches) ≤ 0.2" in str(certificate)
    assert certificate.made_for["targets"] == ["sphere", "cube", "cylinder", "cone"]
    assert sum(certificate.stops) >= 11  # without an error, 11 show that at most 0.2 are wrong


def test_a_file_with_another_certificate_is_not_written_over(made, tmp_path):
    path, certificate = made
    content, asked = path.read_bytes(), {"searches": 40, "max_touches": 2, "out": path, "jobs": 1}
    for change, words in (({"risk": 0.3}, "--risk"), ({"seed": 1}, "--seed"), ({"touch_cost": 0.1}, "rules")):
        with pytest.raises(RunMismatch, match=rf"coarse\.json holds another certificate: other .*{words}\. Choose"):
            activetouch.certify("coarse", **{"risk": 0.2, **asked, **change})
    assert path.read_bytes() == content
    replace(certificate, since=certificate.usual[:1]).save(in_use := tmp_path / "in_use.json")
    with pytest.raises(RunMismatch, match="other searches counted since"):
        activetouch.certify("coarse", risk=0.2, **{**asked, "out": in_use})
    assert activetouch.certify("coarse", risk=0.2, **asked) == certificate
    assert path.read_bytes() == content


def test_compare_plays_the_certified_decider_beside_its_own_and_refuses_another(made):
    found = activetouch.compare("coarse", "information_gain", episodes=1, certificate=made[0], jobs=1)
    assert list(found.deciders) == ["information_gain", "certified information_gain"]
    for arguments in ({"deciders": "threshold"}, {"num_objects": 3}, {"targets": "cone"}, {"abstain": 0.02}):
        with pytest.raises(NotCertified, match=r"the certificate (is for|does not hold here)"):
            activetouch.compare("coarse", **({"deciders": "information_gain"} | arguments), certificate=made[1], jobs=1)
    with pytest.raises(NotCertified, match=r"the scene: other .*renderer"):
        activetouch.compare("gel", "information_gain", certificate=made[1], jobs=1)


def test_a_session_stops_by_the_certificate_and_refuses_another_search(made):
    sensor = TactileSensor.shipped("coarse")
    session = sensor.session("cone", seed=3, certificate=made[0])
    assert session.problem.unsure_reward == 0.0
    image = np.zeros(sensor.scene.image_shape, np.uint8)
    while session.outcome is None:
        session.ask()
        session.tell(image=image) if session.ask().__class__.__name__ == "Probe" else session.tell()
    for arguments in ({"decider": "threshold"}, {"num_objects": 3}, {"touch_cost": 0.1}):
        with pytest.raises(NotCertified, match=r"the certificate (is for|does not hold here)"):
            sensor.session("cone", certificate=made[1], **arguments)


def test_a_session_goes_on_with_the_certificate_that_it_began_with_and_no_other(made, tmp_path):
    sensor, log = TactileSensor.shipped("coarse"), tmp_path / "q.jsonl"
    sensor.session("cone", log=log, certificate=made[0]).close()
    with pytest.raises(OtherModel, match="another certificate, or without one"):
        sensor.session("cone", log=log)
    sensor.session("cone", log=log, certificate=made[0]).close()
    plain = tmp_path / "plain.jsonl"
    sensor.session("cone", log=plain).close()
    with pytest.raises(OtherModel, match="another certificate, or without one"):
        sensor.session("cone", log=plain, certificate=made[0])


def test_searches_that_do_not_look_like_those_of_the_certificate_withdraw_it(made, tmp_path):
    certificate, sensor = made[1], TactileSensor.shipped("coarse")
    with pytest.raises(InvalidArgument, match="ended searches"):
        certificate.after(sensor.session("cone", certificate=certificate))
    rng = np.random.default_rng(0)
    for seed in range(20):
        if certificate.is_withdrawn:
            break
        session = sensor.session("cone", seed=seed, certificate=certificate)
        while session.outcome is None:
            is_touch = session.ask().__class__.__name__ == "Probe"
            session.tell(image=rng.integers(256, size=sensor.scene.image_shape, dtype=np.uint8) if is_touch else None)
        certificate = certificate.after(session)
    assert certificate.is_withdrawn
    assert not made[1].is_withdrawn
    assert f"withdrawn after {len(certificate.since)} searches" in str(certificate)
    certificate.save(tmp_path / "withdrawn.json")
    assert Certificate.load(tmp_path / "withdrawn.json") == certificate
    with pytest.raises(NotCertified, match=r"no longer certified. Calibrate the sensor"):
        sensor.session("cone", certificate=tmp_path / "withdrawn.json")
    with pytest.raises(NotCertified, match="withdrawn"):
        activetouch.compare("coarse", "information_gain", episodes=1, certificate=certificate, jobs=1)


def test_what_cannot_be_certified_is_refused(tmp_path):
    with pytest.raises(TooFewSearches, match=r"at least \d+ calibration searches .* got 4: play more --searches"):
        Certify(risk=0.01, searches=4, max_touches=1, out=tmp_path / "a.json", jobs=1).run()
    assert not (tmp_path / "a.json").exists()
    with pytest.raises(BadArgument, match="--risk"):
        activetouch.certify("coarse", risk=0.0)


def test_a_certified_session_is_unsure_of_a_dead_sensor_unless_it_may_not(made):
    sensor = TactileSensor.shipped("coarse")
    outcomes = {}
    for abstain in (None, False):
        session = sensor.session("cone", seed=3, certificate=made[0], abstain=abstain)
        while session.ask() is not None:
            session.tell(image=np.full((4, 4), 255, np.uint8) if isinstance(session.ask(), Probe) else None)
        outcomes[abstain] = session.outcome
    assert outcomes[None] is Outcome.UNSURE
    assert outcomes[False] is not Outcome.UNSURE
