// Reads what accompanies the scene: JSON, then arrays that it refers to by place.

const TYPES = { f4: Float32Array, f8: Float64Array, u4: Uint32Array };

export function readData(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, 4, length));
  const start = 8 * Math.ceil((4 + length) / 8);
  return JSON.parse(text, (_, value) => {
    const Type = value && TYPES[value.dtype];
    return Type ? new Type(buffer, start + value.offset, value.length) : value;
  });
}
