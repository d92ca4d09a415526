// node vrm.mjs PACKAGES < [path, ...]: what three-vrm finds in each file, and how it moves, as JSON
// Answer: for each file its VRM version, the bones, and where the left hand goes when the arm is turned.
import { readFileSync } from "fs";
import { join } from "path";
import { pathToFileURL } from "url";

const [packages] = process.argv.slice(2);
const inside = name => pathToFileURL(join(packages, "node_modules", name)).href;
globalThis.self = globalThis;
const THREE = await import(inside("three/build/three.module.js"));
const { GLTFLoader } = await import(inside("three/examples/jsm/loaders/GLTFLoader.js"));
const { VRMLoaderPlugin } = await import(inside("@pixiv/three-vrm/lib/three-vrm.module.js"));

// Node has no pictures: every texture is empty
THREE.TextureLoader.prototype.load = (url, done) => { const t = new THREE.Texture(); done?.(t); return t; };
class NoPictures {
  constructor(parser) { this.name = "NO_PICTURES"; this.parser = parser; }
  loadTexture() { return Promise.resolve(new THREE.Texture()); }
}

const answers = [];
for (const path of JSON.parse(readFileSync(0, "utf8"))) {
  const loader = new GLTFLoader();
  loader.register(parser => new NoPictures(parser));
  loader.register(parser => new VRMLoaderPlugin(parser));
  const content = readFileSync(path);
  const bytes = content.buffer.slice(content.byteOffset, content.byteOffset + content.byteLength);
  const gltf = await loader.parseAsync(bytes, "");
  const vrm = gltf.userData.vrm;
  const place = () => {
    vrm.update(0);
    gltf.scene.updateMatrixWorld(true);
    const points = [];
    gltf.scene.traverse(mesh => {
      if (!mesh.isSkinnedMesh) return;
      const point = new THREE.Vector3();
      for (let i = 0; i < mesh.geometry.attributes.position.count; i++)
        points.push(...mesh.localToWorld(mesh.getVertexPosition(i, point)).toArray());
    });
    return points;
  };
  const before = place();
  vrm.humanoid.getNormalizedBoneNode("leftUpperArm").rotation.z = 0.5;
  const after = place();
  const bones = Object.entries(vrm.humanoid.humanBones).filter(([, bone]) => bone?.node);
  answers.push({
    version: vrm.meta.metaVersion,
    bones: Object.fromEntries(bones.map(([name, bone]) => [name, bone.node.name])),
    moved: before.map((value, i) => Math.abs(after[i] - value)).filter(change => change > 1e-3).length,
    numbers: before.length,
  });
}
process.stdout.write(JSON.stringify(answers));
