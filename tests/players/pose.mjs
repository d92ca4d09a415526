// node pose.mjs PACKAGES CHROMIUM < [{path, clip, times}, ...]: where three.js puts every vertex, as JSON
// Answer: for each job and time {"node/primitive": [x, y, z, x, y, z, ...]} in world space.
import { readFileSync } from "fs";
import { createRequire } from "module";
import { join } from "path";

const [packages, executablePath] = process.argv.slice(2);
const { chromium } = createRequire(packages + "/")("playwright-core");
const jobs = JSON.parse(readFileSync(0, "utf8"));

const page_source = `<script type="importmap">{"imports": {
  "three": "/packages/three/build/three.module.js", "three/addons/": "/packages/three/examples/jsm/"}}</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
window.pose = async ({ url, clip, times }) => {
  const gltf = await new GLTFLoader().loadAsync(url);
  const mixer = new THREE.AnimationMixer(gltf.scene);
  const found = gltf.animations.find(animation => animation.name === clip);
  if (clip && !found) throw new Error("no clip " + clip);
  if (found) mixer.clipAction(found).setLoop(THREE.LoopOnce).play().clampWhenFinished = true;
  return times.map(time => {
    if (found) mixer.setTime(time);
    gltf.scene.updateMatrixWorld(true);
    const posed = {};
    gltf.scene.traverse(mesh => {
      if (!mesh.isMesh) return;
      let owner = mesh, seen = gltf.parser.associations.get(mesh) ?? {};
      const primitive = seen.primitives ?? 0;
      while (seen.nodes === undefined && owner) seen = gltf.parser.associations.get(owner = owner.parent) ?? {};
      const point = new THREE.Vector3(), points = [];
      for (let i = 0; i < mesh.geometry.attributes.position.count; i++) {
        mesh.getVertexPosition(i, point);
        points.push(...mesh.localToWorld(point).toArray());
      }
      posed[seen.nodes + "/" + primitive] = points;
    });
    return posed;
  });
};
window.ready = true;
</script>`;

const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
});
try {
  const page = await browser.newPage();
  page.on("pageerror", problem => { throw problem; });
  await page.route("**/*", route => {
    const path = new URL(route.request().url()).pathname;
    if (path === "/") return route.fulfill({ contentType: "text/html", body: page_source });
    const job = path.match(/^\/job\/(\d+)$/);
    if (job) return route.fulfill({ body: readFileSync(jobs[job[1]].path) });
    const file = path.match(/^\/packages\/(.*)$/);
    if (file) return route.fulfill({ contentType: "text/javascript", body: readFileSync(join(packages, "node_modules", file[1])) });
    return route.abort();
  });
  await page.goto("http://players.test/");
  await page.waitForFunction("window.ready");
  const answers = [];
  for (const [index, job] of jobs.entries()) {
    answers.push(await page.evaluate(j => window.pose(j), { ...job, path: undefined, url: `/job/${index}` }));
  }
  process.stdout.write(JSON.stringify(answers));
} finally {
  await browser.close();
}
