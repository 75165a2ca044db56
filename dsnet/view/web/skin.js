// The picture of skin on a body. A drawn vertex has one place on the picture, so that vertices on
// seams are drawn several times: the body's own come first, copies of some of them follow.
import { BufferAttribute, SRGBColorSpace, Texture } from "three";
import { numbersOf } from "./body.js";

const LARGEST = 65535; // of the numbers that places are given by

export class Skin {
  constructor({ faces, copy_of, places }, count) {
    this.count = count;
    this.index = new BufferAttribute(numbersOf(faces, Uint16Array), 1);
    this.copyOf = numbersOf(copy_of, Uint16Array);
    this.drawn = count + this.copyOf.length;
    const numbers = Float32Array.from(numbersOf(places, Uint16Array), (number) => number / LARGEST);
    for (let i = 1; i < numbers.length; i += 2) numbers[i] = 1 - numbers[i]; // the picture's first row is its upper one
    this.places = new BufferAttribute(numbers, 2);
  }

  // Give the copies the values of the vertices that they are copies of.
  copy(values, width) {
    const { copyOf } = this;
    for (let i = 0, to = this.count * width; i < copyOf.length; i++)
      for (let k = 0, from = copyOf[i] * width; k < width; k++) values[to++] = values[from++];
  }
}

// The texture of a PNG file; it is looked up by the second texture coordinates.
export async function pictureOf(png, anisotropy) {
  const image = await createImageBitmap(new Blob([png], { type: "image/png" }));
  return Object.assign(new Texture(image), { colorSpace: SRGBColorSpace, channel: 1, flipY: false, anisotropy, needsUpdate: true });
}
