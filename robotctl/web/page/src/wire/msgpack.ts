// Decodes MessagePack (the specification on msgpack.org), as far as msgspec writes it: no extensions.
//
// Integers beyond 2^53 are rounded to the nearest number: those are times in ns, of which the last
// digits matter to nobody who looks at a page.

const TEXT = new TextDecoder();

class Reader {
  private at = 0;
  private readonly view: DataView;

  constructor(private readonly bytes: Uint8Array) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  get isAtEnd(): boolean {
    return this.at === this.bytes.length;
  }

  value(): unknown {
    const code = this.unsigned(1);
    if (code < 0x80) return code;
    if (code < 0x90) return this.map(code & 0x0f);
    if (code < 0xa0) return this.array(code & 0x0f);
    if (code < 0xc0) return this.text(code & 0x1f);
    if (code >= 0xe0) return code - 0x100;
    switch (code) {
      case 0xc0:
        return null;
      case 0xc2:
        return false;
      case 0xc3:
        return true;
      case 0xc4:
      case 0xc5:
      case 0xc6:
        return this.take(this.unsigned(1 << (code - 0xc4)));
      case 0xca:
        return this.view.getFloat32(this.step(4));
      case 0xcb:
        return this.view.getFloat64(this.step(8));
      case 0xcc:
      case 0xcd:
      case 0xce:
      case 0xcf:
        return this.unsigned(1 << (code - 0xcc));
      case 0xd0:
        return this.view.getInt8(this.step(1));
      case 0xd1:
        return this.view.getInt16(this.step(2));
      case 0xd2:
        return this.view.getInt32(this.step(4));
      case 0xd3:
        return this.view.getInt32(this.step(4)) * 2 ** 32 + this.view.getUint32(this.step(4));
      case 0xd9:
      case 0xda:
      case 0xdb:
        return this.text(this.unsigned(1 << (code - 0xd9)));
      case 0xdc:
      case 0xdd:
        return this.array(this.unsigned(code === 0xdc ? 2 : 4));
      case 0xde:
      case 0xdf:
        return this.map(this.unsigned(code === 0xde ? 2 : 4));
      default:
        throw new Error(`byte 0x${code.toString(16)} at ${this.at - 1} begins no MessagePack value`);
    }
  }

  private step(length: number): number {
    const begin = this.at;
    if (begin + length > this.bytes.length) {
      throw new Error(`MessagePack ends at ${this.bytes.length}, within a value from ${begin} on`);
    }
    this.at = begin + length;
    return begin;
  }

  private unsigned(length: number): number {
    const begin = this.step(length);
    switch (length) {
      case 1:
        return this.view.getUint8(begin);
      case 2:
        return this.view.getUint16(begin);
      case 4:
        return this.view.getUint32(begin);
      default:
        return this.view.getUint32(begin) * 2 ** 32 + this.view.getUint32(begin + 4);
    }
  }

  private take(length: number): Uint8Array {
    const begin = this.step(length);
    return this.bytes.subarray(begin, begin + length);
  }

  private text(length: number): string {
    return TEXT.decode(this.take(length));
  }

  private array(length: number): unknown[] {
    const values: unknown[] = [];
    for (let i = 0; i < length; i++) values.push(this.value());
    return values;
  }

  private map(length: number): Record<string, unknown> {
    const entries: Record<string, unknown> = {};
    for (let i = 0; i < length; i++) entries[String(this.value())] = this.value();
    return entries;
  }
}

/** The one value that the bytes hold; throws an Error for anything else. Binaries share the buffer. */
export function decode(bytes: Uint8Array): unknown {
  const reader = new Reader(bytes);
  const value = reader.value();
  if (!reader.isAtEnd) throw new Error("bytes follow the MessagePack value");
  return value;
}

/** float32, little-endian, of a binary that may lie anywhere in its buffer. */
export function floats(bytes: Uint8Array): Float32Array {
  return new Float32Array(bytes.slice().buffer);
}

/** float64, little-endian, likewise. */
export function doubles(bytes: Uint8Array): Float64Array {
  return new Float64Array(bytes.slice().buffer);
}
