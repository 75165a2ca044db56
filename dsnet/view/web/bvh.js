// BVH, read as bridge/motion/readers/bvh.py reads it and brought to SMPL's joints by the same rules: the asset `rules` is
// Python's constants. A skeleton has names, parents, rest and tips, the axes of each joint's turns, and a motion of count frames.
import { DEG, median, plus } from "./linear.js";
import { BY_PYTHON, refuse } from "./refused.js";
import { retargeted } from "./retargeting.js";
import { jointsByName } from "./skeletons.js";

const LINES = /\r\n|[\n\r\v\f\x1c-\x1e\x85\u2028\u2029]/, NUMBERS = /^[\d\s.eE+-]*$/;

export function readBvh(bytes, rules, mostFrames) {
  if (bytes.length > rules.bvh.MOST_BYTES) refuse(`${bytes.length >> 20} MB; expected at most ${rules.bvh.MOST_BYTES >> 20} MB`);
  const says = [];
  try {
    const person = personOf(skeletonsOf(new TextDecoder().decode(bytes).split(LINES), rules.bvh, says), rules, says);
    return retargeted(person, jointsByName(person, rules.skeletons), rules, says, mostFrames);
  } catch (error) { throw error instanceof TypeError ? new Error(`this page cannot follow its hierarchy: ${BY_PYTHON}`) : error; }
}

// The first that is a person's; of none the largest, whose refusal says what it lacks.
function personOf(skeletons, rules, says) {
  const isPerson = (one) => { try { return Boolean(jointsByName(one, rules.skeletons)); } catch { return false; } };
  const people = skeletons.filter(isPerson), roots = (some) => some.map(({ names }) => names[0]).join(", ").slice(0, 100);
  const person = people[0] ?? skeletons.reduce((most, one) => (one.names.length > most.names.length ? one : most));
  if (people.length > 1) says.push(`It holds ${people.length} people: the first is read, not that of ${roots(people.slice(1))}.`);
  const props = roots(skeletons.filter((one) => !people.includes(one)));
  if (props) says.push(`It also holds ${props}, which is no person and left out.`);
  let most = 0;
  for (let frame = 0; frame < person.count; frame++)
    for (let n = 1; n < person.names.length; n++) for (const angle of person.angles(frame, n)) most = Math.max(most, Math.abs(angle) * DEG);
  if (person.count > 1 && most < rules.bvh.LIKE_RADIANS) says.push(`It turns no joint by more than ${+most.toPrecision(2)} degrees: if these are radians, convert them.`);
  return person;
}

const number = (word) => (word && NUMBERS.test(word) ? Number(word) : NaN);
const finite = (word) => { const value = number(word); return Number.isFinite(value) ? value : refuse(`'${word.slice(0, 20)}' is no finite number`); };
// Some programs write decimal commas, others commas between numbers.
const wordsOf = (line) => line.replaceAll(",", line.includes(".") ? " " : ".").split(/\s+/).filter(Boolean);

function skeletonsOf(lines, { RATES_HZ, ROUNDED, FASTEST, MOST_JOINTS, MOST_FRAMES, HEAD }, says) {
  const begin = lines.findIndex((line) => line.trim().toUpperCase() === "MOTION");
  if (begin < 0) refuse("no line MOTION: this is no BVH");
  const { joints, width } = hierarchy(lines.slice(0, begin), MOST_JOINTS);
  const { stated, rows, count } = motionOf(lines, begin + 1, width, MOST_FRAMES, new RegExp(`^${HEAD}$`, "i"));
  let fps = 1 / number(stated.frametime?.replaceAll(",", "."));
  if (fps > 0.5 && fps < FASTEST && Math.abs(fps - Math.round(fps)) < ROUNDED * Math.round(fps)) fps = Math.round(fps);
  if (!(fps >= RATES_HZ[0] && fps <= RATES_HZ[1])) refuse(`with a 'Frame Time' of ${stated.frametime?.slice(0, 40)}, the seconds from one frame to the next: ${BY_PYTHON} --motion-fps RATE`);
  if (number(stated.frames) !== count) says.push(`It declares ${stated.frames ?? "no number of"} frames and holds ${count}: all are read.`);
  const roots = joints.flatMap(({ parent }, n) => (parent < 0 ? [n] : []));
  return roots.map((first, i) => skeletonOf(joints.slice(first, roots[i + 1]).map((joint) => ({ ...joint, parent: Math.max(joint.parent - first, -1) })), rows, width, count, fps));
}

// The joints, parents first, and how many numbers a frame has.
function hierarchy(lines, most) {
  const joints = [], opened = []; // joints whose brace is open; -1 of a tip
  let isTip = false, width = 0;
  for (const row of lines.flatMap((line) => line.split(/([{}])/))) {
    const words = wordsOf(row), kind = words[0]?.toUpperCase(), joint = joints.at(-1);
    if (kind === "ROOT" || kind === "JOINT") {
      const parent = kind === "ROOT" ? -1 : opened.at(-1) ?? refuse("a JOINT outside of all: this is no BVH");
      joints.push({ name: row.trim().slice(kind.length).trim(), parent, offset: [0, 0, 0], columns: new Map() });
    } else if (kind === "END") isTip = true;
    else if (kind === "{") opened.push(isTip ? -1 : joints.length - 1);
    else if (kind === "}") { if ((opened.pop() ?? refuse("a brace too many: this is no BVH")) === -1) isTip = false; }
    else if (kind === "OFFSET") {
      const place = words.slice(1, 4).map(finite);
      if (place.length !== 3) refuse(`joint ${joint.name} has an OFFSET of ${words.slice(1, 4)}`);
      joint[isTip ? "tip" : "offset"] = place;
    } else if (kind === "CHANNELS") {
      joint.columns = new Map(words.slice(2).map((word, n) => [word[0].toUpperCase() + word.slice(1).toLowerCase(), width + n]));
      if (joint.columns.size < words.length - 2) refuse(`joint ${joint.name} has a channel twice`);
      width += joint.columns.size;
    }
    if (joints.length > most) refuse(`more than ${most} joints`);
  }
  if (!(joints[0]?.parent < 0)) refuse("no ROOT: this is no BVH");
  return { joints, width };
}

// What is stated of the frames, and their numbers. A frame may be wrapped onto several lines, if all are those of the frames declared.
function motionOf(lines, begin, width, most, head) {
  const stated = {}, rows = [];
  let other = null;
  for (const line of lines.slice(begin)) {
    const found = head.exec(line.trim()), words = wordsOf(line);
    if (found) { stated[found[1].toLowerCase().replace(/\s/g, "")] = found[2]; continue; }
    if (words.length && words.length !== width) other ??= words.length;
    for (const word of words) rows.push(finite(word));
    if (rows.length > most * Math.max(width, 1)) refuse(`more than ${most} frames: cut it into several files`);
  }
  const count = rows.length / width;
  if (!rows.length) refuse("no frames");
  if (stated.frames !== undefined && Number.isNaN(number(stated.frames))) refuse(`'Frames: ${stated.frames.slice(0, 20)}' is no number`);
  if (!Number.isInteger(count) || (other !== null && count !== number(stated.frames))) refuse(`${other} numbers in a line of ${width} channels`);
  return { stated, rows: Float64Array.from(rows), count };
}

// The joints below one root.
function skeletonOf(joints, rows, width, count, fps) {
  const axes = joints.map(({ name, columns }) => {
    const order = [...columns.keys()].filter((channel) => channel.endsWith("rotation")).map((channel) => channel[0]).join("");
    const all = order + [..."XYZ"].filter((axis) => !order.includes(axis)).join("").slice(0, Math.max(3 - order.length, 0));
    return new Set(all).size === 3 && /^[XYZ]{3}$/.test(all) ? all : refuse(`joint ${name} with rotations ${order}`);
  });
  const turns = joints.map(({ columns }) => [...columns].filter(([channel]) => channel.endsWith("rotation")).map(([, column]) => column));
  const moved = joints.map(({ columns }) => [..."XYZ"].map((axis) => columns.get(`${axis}position`)));
  const places = moved.map((its) => its.some((column) => column !== undefined));
  const offsets = joints.map(({ offset }) => offset);
  const given = (frame, n) => moved[n].map((column, axis) => (column === undefined ? joints[n].offset[axis] : rows[frame * width + column]));
  for (let n = 1; n < joints.length; n++) // some write places alone
    if (places[n] && !offsets[n].some(Boolean)) offsets[n] = [0, 1, 2].map((axis) => median(count, (frame) => given(frame, n)[axis]));
  const rest = [];
  joints.forEach(({ parent }, n) => rest.push(n ? plus(offsets[n], rest[parent]) : offsets[0]));
  return {
    names: joints.map(({ name }) => name), parents: joints.map(({ parent }) => parent), rest, axes, count, fps,
    tips: joints.map(({ tip }, n) => tip && plus(rest[n], tip)),
    angles: (frame, n) => turns[n].map((column) => rows[frame * width + column] / DEG),
    place: (frame, n) => (places[n] || !n ? given(frame, n) : null),
  };
}
