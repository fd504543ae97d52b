"""Every file is read back, or compiled, and held against the source; what cannot be written is refused."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from models import DT, learned, model

from residual_mpc.cli.main import main
from residual_mpc.errors import BadInput
from residual_mpc.export.agreement import Agreement, Sampling, sample
from residual_mpc.export.compiled import compiler
from residual_mpc.export.onnx_network import from_onnx, to_onnx
from residual_mpc.export.write import write_model
from residual_mpc.learning.network.mlp import forward
from residual_mpc.learning.network.residual import to_json


@pytest.mark.parametrize(("to", "smooth"), [("casadi", 0.0), ("casadi", 1e-2), ("c", 0.0), ("jax", 0.0)])
def test_a_written_model_says_how_far_it_is_from_its_source(to, smooth, tmp_path):
    m = model("together", learned(), smooth=smooth)
    document = write_model(m, to, tmp_path, np.random.default_rng(0))
    apart = document["largest_difference"]
    assert apart["step"] < 1e-11 and apart["points"] == 500
    assert (apart["network"] < 1e-12) == (smooth == 0.0)
    assert json.loads((tmp_path / "export.json").read_text())["states"][0] == {"name": "pose.x", "unit": "m"}
    assert [p["name"] for p in document["parameters"]] == list(m.parameters)


def test_a_difference_has_a_unit(tmp_path):
    document = write_model(model("together"), "casadi", tmp_path, np.random.default_rng(0))
    assert document["largest_difference"]["unit"] in {s["unit"] for s in document["states"]} | {"m or rad"}
    assert document["warnings"] == []


def test_a_step_far_from_the_replay_is_warned_of(tmp_path, monkeypatch, capsys):
    far = Agreement(1e-15, 0.0467, 0.0, 500, "m or rad")
    monkeypatch.setattr("residual_mpc.export.write.agreement", lambda *_: far)
    (tmp_path / "model.json").write_text(
        json.dumps({"schema": "residual-mpc/model/1", "robot": "diff_drive", "values": []})
    )
    with pytest.raises(SystemExit):
        main(["export", str(tmp_path / "model.json"), "--robot", "diff_drive", "--to", "casadi"])
    said = capsys.readouterr()
    assert "over 500 points: 0.047 m or rad\n" in said.out
    warning = "the step is up to 0.047 m or rad off the replay that the diagnosis used, where steps usually stay within"
    assert "warning: over sampled moves " + warning in said.err
    (kept,) = json.loads((tmp_path / "export_casadi" / "export.json").read_text())["warnings"]
    assert warning in kept


@pytest.mark.parametrize("to", ["casadi", "c", "jax", "onnx"])
def test_a_written_model_holds_the_networks_inputs_as_the_learned_one(to, tmp_path):
    if to == "onnx":
        pytest.importorskip("onnx")
    document = write_model(model("none", learned(limit=0.5)), to, tmp_path, np.random.default_rng(0))
    assert document["largest_difference"]["largest"] < 1e-9


@pytest.mark.slow
def test_the_jax_file_stands_alone_and_differentiates(tmp_path):
    m = model("together", learned())
    write_model(m, "jax", tmp_path, np.random.default_rng(0))
    x, u = sample(m, np.random.default_rng(1), Sampling(points=1))
    np.savez(tmp_path / "point.npz", x=x[0], u=u[0])
    program = (
        "import jax, numpy as np, sys\n"
        "jax.config.update('jax_enable_x64', True)\n"
        "import model_jax as m\n"
        "d = np.load('point.npz')\n"
        "p = np.array(m.PARAMETERS)\n"
        "A = jax.jacfwd(m.step)(d['x'], d['u'], p)\n"
        "np.savez('out.npz', new=m.step(d['x'], d['u'], p), A=A)\n"
        "assert 'residual_mpc' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)
    out = np.load(tmp_path / "out.npz")
    np.testing.assert_allclose(out["new"], m.numpy_step(x, u)[0], atol=1e-12)
    from residual_mpc.export import casadi_model

    np.testing.assert_allclose(out["A"], np.array(casadi_model(m).stage(x[0], u[0], m.p)[1]), atol=1e-11)


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_the_c_file_is_loaded_by_casadi_and_its_header_names_every_number(tmp_path):
    import casadi as ca

    m = model("together", learned())
    document = write_model(m, "c", tmp_path, np.random.default_rng(0))
    subprocess.run([compiler(), "-shared", "-fPIC", "model.c", "-o", "model.so", "-lm"], cwd=tmp_path, check=True)
    step = ca.external("step", str(tmp_path / "model.so"))
    x, u = sample(m, np.random.default_rng(1), Sampling(points=1))
    np.testing.assert_allclose(np.array(step(x[0], u[0], m.p)).ravel(), m.numpy_step(x, u)[0], atol=1e-12)
    header = (tmp_path / "model.h").read_text()
    for letter, entries in (("x", document["states"]), ("p", document["parameters"])):
        assert all(f"{letter}[{i}] {e['name']} [{e['unit']}]" in header for i, e in enumerate(entries))
    assert "u[1] command.right [rad/s]" in header
    assert not {"command unit", "actuator unit", ""} & {
        e["unit"] for k in ("states", "parameters") for e in document[k]
    }


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_the_c_file_compiles_without_a_warning(tmp_path):
    write_model(model("together", learned()), "c", tmp_path, np.random.default_rng(0))
    command = [compiler(), "-std=c99", "-Wall", "-Werror", "-Wno-unused", "-c", "model.c", "-o", "model.o"]
    subprocess.run(command, cwd=tmp_path, check=True)


def test_the_network_goes_out_to_onnx_and_back(tmp_path):
    pytest.importorskip("onnx")
    r = learned()
    assert to_onnx(r, tmp_path / "net.onnx") < 1e-9  # ONNX keeps the slope in 32 bits
    document = write_model(model("none", r), "onnx", tmp_path, np.random.default_rng(0))
    assert document["largest_difference"]["largest"] < 1e-9
    import onnx
    from onnx import helper, numpy_helper

    from residual_mpc.learning.network.mlp import layers

    nodes, tensors, last = [], {}, "x"
    for i, (w, b) in enumerate(layers(r.net, r.theta)):
        tensors |= {f"w{i}": w.T.copy(), f"b{i}": b.copy()}
        nodes.append(helper.make_node("Gemm", [last, f"w{i}", f"b{i}"], [f"g{i}"]))
        last = f"g{i}"
        if i < 2:
            nodes.append(helper.make_node("LeakyRelu", [last], [f"a{i}"], alpha=0.01))
            last = f"a{i}"
    info = helper.make_tensor_value_info
    graph = helper.make_graph(
        nodes, "g", [info("x", 11, [None, 5])], [info(last, 11, [None, 3])],
        [numpy_helper.from_array(v, n) for n, v in tensors.items()],
    )  # fmt: skip
    onnx.save(helper.make_model(graph), str(tmp_path / "plain.onnx"))
    net, theta = from_onnx(tmp_path / "plain.onnx")
    assert net == r.net
    z = np.random.default_rng(2).standard_normal((50, 5))
    np.testing.assert_array_equal(forward(net, theta, z), forward(r.net, r.theta, z))
    with pytest.raises(BadInput, match="chain"):
        from_onnx(tmp_path / "net.onnx")  # scaling around the network is not silently dropped
    (tmp_path / "no.onnx").write_bytes(b"not a graph at all")
    with pytest.raises(BadInput):
        from_onnx(tmp_path / "no.onnx")


def test_what_cannot_be_written_is_refused_with_the_reason(tmp_path):
    with pytest.raises(BadInput, match="contains no network"):
        write_model(model("none"), "onnx", tmp_path, np.random.default_rng(0))


def call(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    out = capsys.readouterr()
    return int(end.value.code or 0), out.out, out.err


def test_the_command(tmp_path, capsys):
    robot = tmp_path / "rover.toml"
    robot.write_text('name = "rover"\nplant = "diff_drive"\n[parameters]\nwheel_radius = 0.033\ntrack_width = 0.16\n')
    values = [{"effect": "command_delay", "target": None, "parameter": "delay", "value": 0.07}]
    content = {"schema": "residual-mpc/model/1", "robot": "rover", "values": values, "residual": to_json(learned())}
    file = tmp_path / "model.json"
    file.write_text(json.dumps(content))
    code, out, err = call(capsys, "export", str(file), "--to", "casadi", "--robot", str(robot), "--json")
    assert code == 0, err
    result = json.loads(out)
    assert result["largest_difference"]["largest"] < 1e-9 and result["dt"] == DT
    assert (tmp_path / "export_casadi" / "step.casadi").is_file()
    code, _, err = call(capsys, "export", str(file), "--to", "c")
    assert code == 2 and "--robot" in err
    code, _, err = call(capsys, "export", str(tmp_path / "absent.json"), "--to", "c", "--robot", str(robot))
    assert code == 2 and "Traceback" not in err
    file.write_text(json.dumps({**content, "robot_file": "rover.toml"}))
    code, _, err = call(capsys, "export", str(file), "--to", "c")
    assert code == 0, err
    assert (tmp_path / "export_c" / "model.h").is_file()
