// Which joints of a skeleton are SMPL's, by names and places, as bridge/motion/skeletons.py says; `rules` is what that holds.
import { minus } from "./linear.js";
import { BY_PYTHON, refuse } from "./refused.js";

export function above(skeleton, joint) {
  const found = [];
  while ((joint = skeleton.parents[joint]) >= 0) found.push(joint);
  return found;
}

// The file's joint by SMPL's names.
export function jointsByName(skeleton, rules) {
  const calls = Object.entries(rules.OF_THE_MIDDLE), joints = {}, free = new Map();
  for (const [name, ofSide] of Object.entries(rules.OF_A_SIDE))
    for (const side of rules.SIDES) calls.push([`${side}_${name}`, ofSide.map((call) => side[0] + call)]);
  plainNames(skeleton.names, rules).forEach((plain, n) => { if (!free.has(plain)) free.set(plain, n); });
  for (const [name, theirs] of calls) {
    const call = theirs.find((one) => free.has(one));
    if (call === undefined) continue;
    joints[name] = free.get(call);
    free.delete(call);
  }
  byPlace(skeleton, joints);
  const needed = rules.OWN_NAMES.filter((name) => !rules.MAY_LACK.includes(name.replace(/^left_|^right_/, "")));
  const missing = needed.filter((name) => !(name in joints)).join(", ");
  if (missing) refuse(`its skeleton has no ${missing} (it has ${skeleton.names.join(", ").slice(0, 200)}): ${BY_PYTHON} --joint-map FILE`);
  return { ...spine(skeleton, joints, rules.SPINE), ...joints };
}

// Small letters and digits, the side in front as one letter, without what most of a file's names begin or end with.
export function plainNames(names, { SHARED_PARTS, SHARED, PLAIN }) {
  let left = names.map((name) => name.slice(name.lastIndexOf(":") + 1)), shared = true;
  while (shared) {
    shared = false;
    for (const source of SHARED_PARTS) {
      const pattern = new RegExp(source, "i"), found = left.map((name) => pattern.exec(name)?.[0] ?? ""), counts = new Map();
      for (const part of found) if (part) counts.set(part, (counts.get(part) ?? 0) + 1);
      const [part, count] = [...counts].reduce((most, one) => (one[1] > most[1] ? one : most), ["", 0]);
      if (count < Math.max(SHARED * left.length, 2)) continue;
      shared = true;
      left = left.map((name, n) => (found[n] === part ? name.replace(pattern, "") : name));
    }
  }
  const puts = PLAIN.map(([source, put]) => [new RegExp(source, "g"), put.replaceAll("\\", "$")]);
  return left.map((name) => puts.reduce((plain, [pattern, put]) => plain.replace(pattern, put), name.toLowerCase()));
}

// Pelvis and neck where no name says: above both hips, and below the head.
function byPlace(skeleton, joints) {
  const line = (joint) => [...above(skeleton, joint).reverse(), joint], has = (...names) => names.every((name) => name in joints);
  const parting = (name) => {
    const [one, other] = ["left", "right"].map((side) => line(joints[`${side}_${name}`]));
    return one.filter((joint, n) => joint === other[n]);
  };
  if (!has("pelvis") && has("left_hip", "right_hip")) {
    const pelvis = parting("hip").filter((joint) => !Object.values(joints).includes(joint)).at(-1);
    if (pelvis !== undefined) joints.pelvis = pelvis;
  }
  if (!has("neck") && has("head", "left_shoulder", "right_shoulder")) {
    const below = parting("shoulder"), neck = line(joints.head).slice(0, -1).find((joint) => !below.includes(joint));
    if (neck !== undefined) joints.neck = neck;
  }
}

// Of the joints between pelvis and neck the lowest, the middle and the highest.
function spine(skeleton, joints, [low, mid, high]) {
  const below = [joints.pelvis, ...above(skeleton, joints.pelvis)], rest = (joint) => skeleton.rest[joint];
  let between = above(skeleton, joints.neck ?? joints.head ?? joints.left_shoulder), end = between.findIndex((joint) => below.includes(joint));
  between = between.slice(0, end < 0 ? undefined : end).reverse().filter((joint) => !Object.values(joints).includes(joint));
  // A first one in the pelvis is its second frame.
  if (between.length > 3 && minus(rest(between[0]), rest(joints.pelvis)).every((x, i) => Math.abs(x) <= 1e-8 + 1e-5 * Math.abs(rest(joints.pelvis)[i]))) between.shift();
  if (!between.length) return {};
  if (between.length === 1) return { [mid]: between[0] };
  if (between.length === 2) return { [low]: between[0], [high]: between[1] };
  return { [low]: between[0], [mid]: between[between.length >> 1], [high]: between.at(-1) };
}
