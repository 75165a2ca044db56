// From the skeleton of a file to SMPL's 22 joints, as bridge/motion/retargeting.py does it: G_j(t) = U B_j(t) R_j.
import { angleDeg, apply, cross, DEG, dot, EYE, inverse, largest, mean, median, minus, product, quaternion, quaternionOf, rotvec, scaled, size, times, transposed, turnAbout, unit, plus } from "./linear.js";
import { refuse } from "./refused.js";
import { sampled } from "./resampling.js";
import { between, legLength, restTurns, standingUp, turnDeg } from "./rest_poses.js";
import { above } from "./skeletons.js";

const ABOUT = { X: [1, 0, 0], Y: [0, 1, 0], Z: [0, 0, 1] }, FROM_ROOT_JOINT = [[-1, 0, 0], [0, -1, 0], [0, 0, -1]];
const rounded = (x) => (x % 1 === 0.5 ? 2 * Math.round(x / 2) : Math.round(x)); // as Python does
const byName = (joints, of) => Object.fromEntries(Object.entries(joints).map(([name, joint]) => [name, of[joint]]));

// Rotations and places of all joints in the file's world.
function posed({ parents, axes, rest, angles, place }, frame) {
  const turns = [], places = [];
  for (let n = 0; n < parents.length; n++) {
    let turn = EYE;
    angles(frame, n).forEach((angle, i) => { turn = product(turn, turnAbout(ABOUT[axes[n][i]], angle)); });
    const parent = parents[n], own = place(frame, n);
    turns.push(parent < 0 ? turn : product(turns[parent], turn));
    places.push(parent < 0 ? own : plus(places[parent], apply(turns[parent], own ?? minus(rest[n], rest[parent]))));
  }
  return { turns, places };
}

// The same with one axis the other way round.
function mirrored(skeleton, axis) {
  const flip = (v) => v && v.map((x, i) => (i === axis ? -x : x)), sign = (n, i) => (skeleton.axes[n][i] === "XYZ"[axis] ? 1 : -1);
  return { ...skeleton, rest: skeleton.rest.map(flip), tips: skeleton.tips.map(flip), place: (frame, n) => flip(skeleton.place(frame, n)),
           angles: (frame, n) => skeleton.angles(frame, n).map((angle, i) => angle * sign(n, i)) };
}

// Whether feet and knees point backwards, seen from where left and right are.
function isMirrored(frames, rules) {
  const toes = [], knees = [];
  for (const at of frames) {
    const across = plus(unit(minus(at.left_hip, at.right_hip)), unit(minus(at.left_shoulder, at.right_shoulder)));
    const forward = unit(cross(across, minus(between(at, "shoulder"), between(at, "hip"))));
    for (const side of rules.SIDES) {
      const [hip, knee, ankle, foot] = ["hip", "knee", "ankle", "foot"].map((name) => at[`${side}_${name}`]);
      const sine = size(cross(unit(minus(knee, hip)), unit(minus(ankle, knee))));
      knees.push(dot(unit(minus(minus(scaled(knee, 2), hip), ankle)), forward) * sine);
      if (!foot) continue;
      const shin = unit(minus(knee, ankle)), toe = minus(foot, ankle);
      toes.push(dot(unit(minus(toe, scaled(shin, dot(toe, shin)))), forward));
    }
  }
  const bent = mean(knees);
  return toes.length ? median(toes.length, (i) => toes[i]) < -0.5 && bent < rules.STRAIGHT : bent < -rules.STRAIGHT;
}

// The joints whose frames are those of SMPL's. Both hips may lie still in another than the pelvis's; a limb's twist is that of its last joint.
function carriersOf(skeleton, joints, frames, rules) {
  const { parents } = skeleton, [left, right] = rules.SIDES.map((side) => parents[joints[`${side}_hip`]]), carriers = { ...joints };
  const apart = (one, other) => turnDeg(frames.length, (i) => frames[i].turns.at(one), (i) => frames[i].turns.at(other)) > rules.SAME_FRAME_DEG;
  if (left !== right && !apart(left, right) && apart(joints.pelvis, left)) carriers.pelvis = left;
  for (const [name, [, end]] of Object.entries(rules.LIMBS))
    if (!name.endsWith("ankle") && end in joints && above(skeleton, joints[end]).includes(joints[name])) carriers[name] = parents[joints[end]];
  return carriers;
}

const axisOf = (direction) => { const i = largest(direction); return (direction[i] < 0 ? "-" : "") + "xyz"[i]; };

// The turn from the file's world to y up.
function uprightTurn(rest, frames, { retargeting: rules, rest_poses }, says) {
  const restUp = standingUp(rest, rest_poses), directions = frames.map((at) => {
    const hips = between(at, "hip");
    return plus(unit(minus(between(at, "shoulder"), hips)), unit(minus(hips, between(at, "ankle"))));
  });
  const standing = [0, 1, 2].map((i) => 0.5 * mean(directions.map((one) => one[i]))), share = Math.max(...standing.map(Math.abs));
  const restAxis = restUp && axisOf(restUp);
  let axis = axisOf(standing);
  if (share < rules.STANDING) {
    axis = restAxis ?? "y";
    says.push(`It stands neither along y nor z for most of the motion: taken as ${axis} up.`);
  } else if (restAxis && restAxis !== axis) {
    if (share < rules.SURELY_STANDING || (restAxis[0] === "-" ? -1 : 1) * standing["xyz".indexOf(restAxis.at(-1))] > rules.SURELY_LYING) axis = restAxis;
    else says.push(`It rests with ${restAxis} up and moves with ${axis} up, which is believed.`);
  }
  const [about, degrees] = rules.UPRIGHT[axis];
  return turnAbout(ABOUT[about.toUpperCase()], degrees / DEG).map((x) => +x.toFixed(12));
}

// Compare limbs and lines of the moved body with the file's.
function check(worlds, frames, upright, own, rules, says) {
  const apart = {}, moved = worlds.map((world) => {
    const places = {};
    rules.OWN_NAMES.forEach((name, n) => {
      const parent = rules.SMPL_PARENTS[n], over = rules.OWN_NAMES[parent];
      places[name] = n ? plus(places[over], apply(world[parent], minus(own[name], own[over]))) : [0, 0, 0];
    });
    return places;
  });
  for (const [name, [one, end]] of Object.entries({ ...rules.LINES, ...rules.LIMBS }))
    if (frames[0][one] && frames[0][end])
      apart[name] = median(frames.length, (i) => angleDeg(apply(upright, minus(frames[i][end], frames[i][one])), minus(moved[i][end], moved[i][one])));
  const far = Object.keys(apart).filter((name) => apart[name] > (rules.WARN_DEG[name.slice(name.lastIndexOf("_") + 1)] ?? rules.LIMB_WARN_DEG));
  const limbs = far.map((name) => `${name} by ${apart[name].toFixed(0)} degrees`).join(", ");
  if (far.some((name) => apart[name] > rules.REFUSED_DEG)) refuse(`a body cannot follow its joints: off are ${limbs}. Export it with a T-pose as rest pose`);
  if (far.length) says.push(`It is followed with limbs that differ from the file's: ${limbs}.`);
}

// The first frames, in which a program finds the skeleton: those up to the end of a jump.
function framesOfRestPose(turns, fps, rules) {
  const steps = Math.min(Math.max(1, rounded(rules.LONGEST_JUMP_S * fps)), turns.length - 2), speeds = [];
  for (let i = 0; i < steps; i++)
    speeds.push(fps * Math.max(...turns[i].map((turn, joint) => size(rotvec(times(inverse(quaternion(turn)), quaternion(turns[i + 1][joint])))))));
  return speeds[0] >= rules.JUMP_RAD_S ? speeds.findLastIndex((speed) => speed >= rules.SETTLED_RAD_S) + 1 : 0;
}

// What a page performs, of a skeleton whose joints are known by SMPL's names.
export function retargeted(skeleton, joints, all, says, mostFrames) {
  const rules = all.retargeting, names = rules.OWN_NAMES, { count, fps } = skeleton;
  const own = Object.fromEntries(names.map((name, n) => [name, all.mean_joints[n]])), some = Math.min(rules.SAMPLED, count), step = some > 1 ? (count - 1) / (some - 1) : 0;
  const chosen = Array.from({ length: some }, (_, i) => (i && i === some - 1 ? count - 1 : Math.floor(i * step)));
  const legs = legLength(byName(joints, skeleton.rest));
  if (!(legs > 0)) refuse("its legs have no length");
  let frames = chosen.map((frame) => posed(skeleton, frame));
  if (isMirrored(frames.map(({ places }) => byName(joints, places)), rules)) {
    const axis = largest(minus(skeleton.rest[joints.left_hip], skeleton.rest[joints.right_hip]));
    says.push(`It is left-handed, its feet point backwards: its ${"xyz"[axis]} axis is taken the other way round.`);
    skeleton = mirrored(skeleton, axis);
    frames = chosen.map((frame) => posed(skeleton, frame));
  }
  const carriers = carriersOf(skeleton, joints, frames, rules), placed = frames.map(({ places }) => byName(joints, places));
  const upright = uprightTurn(byName(joints, skeleton.rest), placed, all, says);
  const sample = { count: some, turns: (i, name) => frames[i].turns[carriers[name]], places: (i, name) => placed[i][name] };
  const { found, feet } = restTurns(skeleton, joints, own, sample, apply(transposed(upright), [0, 1, 0]), all);
  if (feet.length) says.push(`It rests with feet that point another way than a standing body's: ${feet.join(" and ")} are taken to stand flat where they are lowest.`);
  const worldOf = ({ turns }) => names.reduce((world, name, n) => {
    world.push(found[name] ? product(product(upright, turns[carriers[name]]), found[name]) : world[rules.SMPL_PARENTS[n]]);
    return world;
  }, []);
  check(frames.map(worldOf), placed, upright, own, rules, says);

  const scale = legLength(own) / legs, below = minus(between(own, "hip"), own.pelvis), turns = [], path = [];
  for (let frame = 0; frame < count; frame++) {
    const at = posed(skeleton, frame), world = worldOf(at);
    turns.push(world.map((turn, n) => rotvec(quaternionOf(n ? product(transposed(world[rules.SMPL_PARENTS[n]]), turn) : turn))));
    path.push(minus(scaled(apply(upright, between(byName(joints, at.places), "hip")), scale), apply(world[0], below)));
  }
  for (const place of path) for (const x of place) if (!(Math.abs(x) <= rules.FARTHEST_M)) refuse(`it goes ${Math.abs(x).toPrecision(3)} m off: export it near the origin`);
  const first = framesOfRestPose(turns, fps, all.cuts);
  if (first) says.push(`The motion begins after frame ${first} of the file; before it stands a pose from which nobody gets there so fast.`);
  const poses = Float64Array.from(turns.slice(first).flat(2)), trans = Float64Array.from(path.slice(first).flat());
  return { ...sampled({ poses, trans, frames: count - first, width: 3 * names.length, rate: fps, up: "y" }, mostFrames), by_joint: FROM_ROOT_JOINT, unplaced: true,
           betas: Array(10).fill(0), gender: "unknown", embedded: false, says };
}
