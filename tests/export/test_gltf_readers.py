"""skin.glb as others read it: three.js in Chromium, the Khronos validator in node, trimesh."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess

import numpy as np
import pytest
import trimesh

import skinbake
from skinbake.cli import run
from skinbake.export.gltf import NAME
from tests.export.browser import Browser

pytestmark = pytest.mark.slow  # processes, and packages from a registry

PACKAGES = ("three@0.187.0", "gltf-validator@2.0.0-dev.3.10")
NPM = ("npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", "--fetch-retries=0", "--fetch-timeout=15000")
VALIDATE = """
const bytes = new Uint8Array(require("fs").readFileSync(process.argv[1]));
require("gltf-validator").validateBytes(bytes).then((found) => console.log(JSON.stringify(found.issues)));
"""
PAGE = """<!doctype html>
<script type="importmap">{"imports": {"three": "./node_modules/three/build/three.module.js"}}</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "./node_modules/three/examples/jsm/loaders/GLTFLoader.js";
const bytes = Uint8Array.from(atob("@BYTES@"), (c) => c.charCodeAt(0));
new GLTFLoader().parse(bytes.buffer, "", async (gltf) => {
  const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(40, 1, 0.01, 1);
  scene.add(gltf.scene);
  camera.position.z = 0.12;
  const canvas = Object.assign(document.createElement("canvas"), { width: 64, height: 64 });
  const renderer = new THREE.WebGLRenderer({ canvas, preserveDrawingBuffer: true });
  renderer.render(scene, camera);
  const page = Object.assign(document.createElement("canvas"), { width: 64, height: 64 }).getContext("2d");
  page.drawImage(canvas, 0, 0);
  const mesh = gltf.scene.getObjectByProperty("isMesh", true), medium = await gltf.parser.getDependency("material", 1);
  const box = new THREE.Box3().setFromObject(mesh);
  window.found = {
    kind: mesh.material.type, size: [mesh.material.map.image.width, mesh.material.map.image.height],
    height: box.max.y - box.min.y, lights: gltf.asset.extras.skinbake.lights,
    pixel: [...page.getImageData(32, 32, 1, 1).data],
    medium: [medium.type, medium.attenuationDistance, medium.attenuationColor.toArray(), medium.ior],
    unknown: Object.keys(medium.userData.gltfExtensions), normal: Boolean(medium.normalMap),
  };
});
</script>"""


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """Folder with the packages that read it."""
    if not shutil.which("npm") or not shutil.which("node"):
        pytest.skip("node and npm are not installed")
    folder = tmp_path_factory.mktemp("npm")
    done = subprocess.run([*NPM, *PACKAGES], cwd=folder, capture_output=True, text=True, timeout=120)
    if done.returncode:
        pytest.skip(f"npm could not install {', '.join(PACKAGES)}: {(done.stderr.strip() or 'failed').splitlines()[0]}")
    return folder


@pytest.fixture(scope="module")
def exported(bake, tmp_path_factory):
    """The ball, baked with a medium of one layer, and its GLB."""
    folder = tmp_path_factory.mktemp("glb")
    verb = ["bake", str(bake.parent / "me.yaml"), "--set", "skin={preset: jensen-skin1}", "--no-preview", "--quiet"]
    assert run([*verb, "--set", "texture.size=64", "--out", str(folder / "bake")]) == 0
    assert run(["export", str(folder / "bake"), "--to", str(folder), "--gltf", "--quiet"]) == 0
    return folder


def document(path):
    data = path.read_bytes()
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def test_a_medium_of_one_layer_is_the_second_variant(exported):
    """Over its distance light loses what sigma_a takes; the first variant is the baked light, without lights."""
    tree, baked = document(exported / NAME), skinbake.open_bake(exported / "bake")
    shown, medium = tree["materials"]
    assert shown["extensions"] == {"KHR_materials_unlit": {}}
    volume = medium["extensions"]["KHR_materials_volume"]
    absorbed = -np.log(volume["attenuationColor"]) / (1000 * volume["attenuationDistance"])
    np.testing.assert_allclose(absorbed, baked.look.skin.sigma_a_per_mm, rtol=1e-6)
    assert medium["extensions"]["KHR_materials_ior"] == {"ior": baked.look.skin.eta}
    assert medium["extensions"]["KHR_materials_diffuse_transmission"] == {"diffuseTransmissionFactor": 1.0}
    (layer,) = tree["asset"]["extras"]["skinbake"]["medium"]
    assert layer["sigma_sp_per_mm"] == list(baked.look.skin.sigma_sp_per_mm)
    (primitive,) = tree["meshes"][0]["primitives"]
    names = [variant["name"] for variant in tree["extensions"]["KHR_materials_variants"]["variants"]]
    mappings = primitive["extensions"]["KHR_materials_variants"]["mappings"]
    assert {names[each["variants"][0]]: each["material"] for each in mappings} == {"baked light": 0, "medium": 1}
    assert set(tree["extensionsUsed"]) == {
        "KHR_materials_unlit", "KHR_materials_variants", *medium["extensions"]
    }  # fmt: skip
    assert len(tree["images"]) == 4  # normals and roughness once
    assert len(trimesh.load(exported / NAME).geometry) == 1


def test_the_validator_finds_nothing(exported, bake, packages, tmp_path):
    """No error and no warning, with a medium and without."""
    assert run(["export", str(bake), "--to", str(tmp_path), "--gltf", "--quiet"]) == 0
    for path in (exported / NAME, tmp_path / NAME):
        done = subprocess.run(
            ["node", "-e", VALIDATE, str(path)], cwd=packages, capture_output=True, text=True, check=True
        )
        found = json.loads(done.stdout)
        assert (found["numErrors"], found["numWarnings"]) == (0, 0), found["messages"]
        codes = {message["code"] for message in found["messages"]}
        assert codes <= {"IMAGE_NPOT_DIMENSIONS", "UNSUPPORTED_EXTENSION"}  # of 64 x 48; diffuse transmission


def test_three_js_draws_it(exported, packages, tmp_path):
    """Unlit, in metres; the colour in the middle of the ball is that of the texture; the medium's figures are read."""
    glb = exported / NAME
    (packages / "page.html").write_text(PAGE.replace("@BYTES@", base64.b64encode(glb.read_bytes()).decode()))
    with Browser(tmp_path / "browser") as browser:
        browser.open(packages / "page.html")
        found = browser.run("await until(() => window.found); return window.found;")
        assert browser.problems == []
    tree = document(glb)
    assert found["kind"] == "MeshBasicMaterial"
    assert found["size"] == [64, 64]
    assert found["height"] == pytest.approx(0.06, rel=0.01)
    assert found["lights"] == ["key", "lamp"]
    volume = tree["materials"][1]["extensions"]["KHR_materials_volume"]
    kind, distance, colour, ior = found["medium"]
    assert (kind, ior) == ("MeshPhysicalMaterial", 1.3)
    assert distance == pytest.approx(volume["attenuationDistance"])
    np.testing.assert_allclose(colour, volume["attenuationColor"], rtol=1e-6)
    assert found["unknown"] == ["KHR_materials_diffuse_transmission"]
    assert found["normal"]
    (mesh,) = trimesh.load(glb).geometry.values()
    front = mesh.visual.uv[mesh.vertices[:, 2].argmax()]
    picture = np.asarray(mesh.visual.material.baseColorTexture)[..., :3]
    row, column = int((1 - front[1]) * 64), int(front[0] * 64)
    near = picture[row - 2 : row + 3, column - 2 : column + 3].reshape(-1, 3).astype(int)
    assert (near.min(0) - 12 <= found["pixel"][:3]).all()
    assert (found["pixel"][:3] <= near.max(0) + 12).all()
