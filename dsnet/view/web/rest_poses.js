// What turns SMPL's rest pose into the frames of a file's joints, as bridge/motion/rest_poses.py finds it.
import { angleDeg, angleOf, apply, columns, cross, DEG, dot, largest, median, minus, plus, product, scaled, shortestTurn, size, sorted, transposed, turnAbout, unit } from "./linear.js";
import { refuse } from "./refused.js";
import { plainNames } from "./skeletons.js";

const X = [1, 0, 0], Y = [0, 1, 0], Z = [0, 0, 1], AXES = [X, Y, Z, scaled(X, -1), scaled(Y, -1), scaled(Z, -1)];
export const between = (places, name) => scaled(plus(places[`left_${name}`], places[`right_${name}`]), 0.5);
export const legLength = (rest) => size(minus(rest.left_knee, rest.left_hip)) + size(minus(rest.left_ankle, rest.left_knee));
export const turnDeg = (count, one, other) => DEG * median(count, (i) => angleOf(product(transposed(one(i)), other(i))));

// Where the head is, if it rests as somebody stands; else null.
export function standingUp(rest, rules) {
  const up = apply(pelvisFrame(rest, rules), Y), trunk = minus(between(rest, "shoulder"), between(rest, "hip"));
  const legs = rules.SIDES.map((side) => minus(rest[`${side}_ankle`], rest[`${side}_hip`]));
  return angleDeg(trunk, up) < 45 && legs.every((leg) => angleDeg(leg, scaled(up, -1)) < 60) ? up : null;
}

// By trunk and legs: no single joint tells.
function pelvisFrame(rest, rules) {
  const hips = between(rest, "hip"), trunk = unit(minus(between(rest, "shoulder"), hips)), legs = unit(minus(hips, between(rest, "ankle")));
  const apart = angleDeg(trunk, legs), both = apart < rules.OPPOSITE_DEG ? plus(trunk, legs) : trunk;
  const across = ["hip", "shoulder"].map((pair) => minus(rest[`left_${pair}`], rest[`right_${pair}`]));
  return frameOf([both, trunk], across, apart < rules.AGREED_DEG ? rules.TILTED_DEG : rules.SNAPPED_UP_DEG, rules) ?? refuse("its hips and trunk lie in one line at rest");
}

// Left, up and forward as columns, along the file's own axes where they are near; null where left is up.
function frameOf(ups, across, mostDeg, rules) {
  const agreed = across.length > 1 && angleDeg(...across) < rules.AGREED_SIDES_DEG;
  let left = snapped(unit(across[0]), agreed ? rules.TURNED_DEG : rules.SNAPPED_SIDE_DEG), up = minus(unit(ups[0]), scaled(left, dot(unit(ups[0]), left)));
  if (!(size(up) > 1e-6)) return null;
  const axes = AXES.filter((one) => Math.abs(angleDeg(one, left) - 90) < (agreed ? rules.TURNED_DEG : rules.SNAPPED_UP_DEG));
  const lines = [...axes, ...axes.map((axis) => cross(axis, left))], far = lines.map((line) => Math.min(...ups.map((one) => angleDeg(line, one))));
  if (far.length && Math.min(...far) < mostDeg) up = lines[far.indexOf(Math.min(...far))];
  up = unit(up);
  left = unit(minus(left, scaled(up, dot(left, up))));
  return columns(left, up, cross(left, up));
}

function snapped(direction, mostDeg) {
  const axis = [0, 0, 0], i = largest(direction);
  axis[i] = Math.sign(direction[i]);
  return angleDeg(direction, axis) < mostDeg ? axis : direction;
}

// Of the joint from which both collars and the neck go out.
function chestFrame({ parents }, joints, rest, rules) {
  const pair = rest.left_collar && rest.right_collar ? "collar" : "shoulder", ends = [`left_${pair}`, `right_${pair}`, "neck"];
  if (!rest.spine3 || ends.some((end) => !rest[end] || parents[joints[end]] !== joints.spine3)) return null;
  const up = minus(rest.neck, rest.spine3);
  return size(up) < 1e-9 ? null : frameOf([up], [minus(rest[`left_${pair}`], rest[`right_${pair}`])], rules.SNAPPED_UP_DEG, rules);
}

// The turn by the name of every joint that the file has, and the ankles that are taken to stand flat where they are lowest.
// `own` are SMPL's joints at rest by name; in each of count sampled frames `turns` and `places` give a joint's by its name.
export function restTurns(skeleton, joints, own, { count, turns, places }, up, { rest_poses: rules, skeletons }) {
  const rest = Object.fromEntries(Object.entries(joints).map(([name, joint]) => [name, skeleton.rest[joint]]));
  const frames = { pelvis: pelvisFrame(rest, rules) }, found = { ...frames }, feet = [];
  const chest = chestFrame(skeleton, joints, rest, rules), stands = standingUp(rest, rules) !== null;
  const boneOf = (name, end) => {
    const bone = end && rest[end] && minus(rest[end], rest[name]);
    return bone && size(bone) > 1e-9 ? bone : null;
  };
  const isSmpls = restsAsSmpl();

  function restsAsSmpl() {
    const plain = plainNames(skeleton.names, skeletons);
    return plainNames(rules.OWN_NAMES, skeletons).every((name) => plain.includes(name)) && Object.entries(rules.BONES).every(([name, [end]]) => {
      const most = rules.OWN_DEG[name.slice(name.lastIndexOf("_") + 1)], bone = boneOf(name, end);
      return !most || !end || (bone && angleDeg(minus(own[end], own[name]), bone) <= most);
    });
  }

  // The one with which the joint turns least throughout, or the first if none is clearly.
  function quietest(name, over, options) {
    const world = (i) => product(turns(i, over), found[over]), turned = options.map((one) => turnDeg(count, world, (i) => product(turns(i, name), one)));
    const best = turned.indexOf(Math.min(...turned));
    return options[turned[best] < turned[0] - rules.CLEARLY_DEG ? best : 0];
  }

  // As it stands on the floor, if it does not rest so.
  function ankle(name, frame, bone) {
    const toes = name.replace("ankle", "foot"), joint = joints[toes];
    if (stands && angleDeg(apply(frame, minus(own[toes], own[name])), bone) < rules.FOOT_DEG) return frame;
    const flat = minus(skeleton.tips[joint] ?? rest[toes], rest[toes]), apart = angleDeg(flat, bone);
    if (stands && rules.FOOT_SHAPE_DEG[0] < apart && apart < rules.FOOT_SHAPE_DEG[1]) return product(shortestTurn(apply(frame, Z), flat), frame);
    feet.push(name);
    const heights = Array.from({ length: count }, (_, i) => dot(places(i, toes), up)), at = rules.STANCE * (count - 1), all = sorted(count, (i) => heights[i]);
    const low = all[Math.floor(at)] + (at % 1) * (all[Math.ceil(at)] - all[Math.floor(at)]);
    const soles = heights.flatMap((height, i) => (height <= low ? [apply(transposed(turns(i, name)), up)] : []));
    const sole = unit([0, 1, 2].map((axis) => median(soles.length, (i) => soles[i][axis])));
    let forward = minus(bone, scaled(sole, dot(bone, sole)));
    if (!(size(forward) > 1e-9)) forward = cross(sole, plus(X, sole.toReversed()));
    return columns(cross(sole, unit(forward)), sole, unit(forward));
  }

  // The frame turned so that its axis `along` points as the bone, in each of four quarters.
  function swung(frame, along, bone) {
    const start = apply(frame, along), end = apply(frame, snapped(unit(apply(transposed(frame), bone)), rules.SNAPPED_BONE_DEG));
    const swing = angleDeg(start, end) > 179 ? turnAbout(unit(apply(frame, Math.abs(along[2]) < 0.5 ? Z : X)), Math.PI) : shortestTurn(start, end);
    return [0, 1, 2, 3].map((quarter) => product(product(turnAbout(end, (quarter * Math.PI) / 2), swing), frame));
  }

  // First about forward, as arms that hang in an A are, then the shortest way.
  function onto(frame, start, bone) {
    const level = ([x, y]) => apply(frame, [x, y, 0]), ahead = level(start), end = level(apply(transposed(frame), bone));
    const isLevel = angleDeg(bone, end) <= rules.AHEAD_DEG && angleDeg(ahead, end) <= rules.OPPOSITE_DEG, turned = isLevel ? product(shortestTurn(ahead, end), frame) : frame;
    return product(shortestTurn(apply(turned, start), bone), turned);
  }

  rules.OWN_NAMES.forEach((name, number) => {
    if (!number || !(name in joints)) return;
    let parent = number;
    do parent = rules.SMPL_PARENTS[parent]; while (!found[rules.OWN_NAMES[parent]]);
    const over = rules.OWN_NAMES[parent], [end, along, mostDeg] = rules.BONES[name], bone = boneOf(name, end);
    const isLimb = end && rules.LIMBS.some((limb) => name.endsWith(limb)), smplBone = isLimb ? minus(own[end], own[name]) : along;
    let frame = frames[over];
    if (name === "spine3" && chest && angleDeg(apply(frame, X), apply(chest, X)) > rules.OTHER_CHEST_DEG) frame = chest;
    if (!isSmpls && name.endsWith("ankle") && bone) frame = ankle(name, frame, bone);
    else if (!isSmpls && !bone) {
      const inherited = name.endsWith("wrist") ? found[over] : frame;
      frame = stands && !feet.includes(over) ? inherited : quietest(name, over, [inherited, ...rules.CUBE.map((one) => one.flat())]);
    } else if (!isSmpls && (!stands || angleDeg(apply(frame, smplBone), bone) > mostDeg))
      frame = quietest(name, over, [...(along[1] > 0 ? [frame] : []), ...swung(frame, along, bone)]);
    frames[name] = found[name] = frame;
    if (isLimb && bone && !isSmpls) found[name] = onto(frame, smplBone, bone);
  });
  return { found, feet };
}
