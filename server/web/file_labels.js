// What a recording's file says of itself, as far as a browser can read it: before it is sent, to be seen and changed.

const HEAD_BYTES = 4096;
const JSON_BYTES = 4e6; // a session of 40,000 samples
const LABEL_BYTES = 8192; // of one variable of a MAT file; what is larger is no label
const VARIABLES = 100; // of a MAT file that are looked at
const KEY = /^([A-Za-z][\w.-]*)[ \t]*:(.*)$/;

/// The first characters of a file, unpacked where it is gzip.
async function headOf(file, most) {
  if (!/\.gz$/i.test(file.name)) return file.slice(0, most).text();
  const reader = file.stream().pipeThrough(new DecompressionStream("gzip")).pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  try {
    while (text.length < most) {
      const { value, done } = await reader.read();
      if (done) break;
      text += value;
    }
  } catch {
    // No gzip after all: the server says so when it is sent.
  }
  reader.cancel().catch(() => {});
  return text.slice(0, most);
}

/// `# key: value` lines at the head of a CSV, by the server's rule (core/recording/metadata.h): several pairs may stand in a
/// line, a value ends before the next ` # ` and before a remark in parentheses that two blanks set off.
export function headLabels(text) {
  const labels = {};
  for (const line of text.split(/\r?\n/).map((whole) => whole.trim()).filter(Boolean)) {
    if (!line.startsWith("#")) break;
    for (const part of line.replace(/^#+/, "").split(/[ \t]#+(?=[ \t]|$|[A-Za-z][\w.-]*[ \t]*:)/)) {
      const [, key, value] = KEY.exec(part.trim()) ?? [];
      const said = value?.trim().replace(/[ \t]{2,}\(.*$/, "");
      if (said) labels[key.toLowerCase()] ??= said;
    }
  }
  return labels;
}

/// `metadata` of a JSON recording that is small enough to be read here; null where it is not.
async function jsonLabels(file) {
  if (file.size > JSON_BYTES) return null;
  try {
    const { metadata } = JSON.parse(await headOf(file, 20 * JSON_BYTES));
    return Object.fromEntries(Object.entries(metadata ?? {}).filter(([, value]) => typeof value === "string"));
  } catch {
    return {}; // the server says what is wrong with it
  }
}

const MATRIX = 14, PACKED = 15, CHARACTERS = 4;
const LETTERS = { 1: "utf-8", 2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16" };

/// The parts of a MAT v5 element from `at` on: [{type, bytes}], each a view.
function partsOf(view, at, little) {
  const parts = [];
  while (at + 8 <= view.byteLength && parts.length < 4) {
    const first = view.getUint32(at, little);
    const small = first >>> 16; // a part of at most four bytes stands in its own tag
    const [type, size, begin] = small ? [first & 0xffff, small, at + 4] : [first, view.getUint32(at + 4, little), at + 8];
    if (begin + size > view.byteLength) break;
    parts.push({ type, bytes: new DataView(view.buffer, view.byteOffset + begin, size) });
    at = small ? at + 8 : begin + Math.ceil(size / 8) * 8;
  }
  return parts;
}

/// [name, text] of a variable of characters; null of any other.
function textVariable(view, little) {
  const [flags, , name, letters] = partsOf(view, 8, little);
  if (!letters || (flags.bytes.getUint32(0, little) & 0xff) !== CHARACTERS || !LETTERS[letters.type]) return null;
  const coding = LETTERS[letters.type] === "utf-16" ? `utf-16${little ? "le" : "be"}` : "utf-8";
  return [new TextDecoder().decode(name.bytes), new TextDecoder(coding).decode(letters.bytes).trim()];
}

async function unpacked(blob) {
  const reader = blob.stream().pipeThrough(new DecompressionStream("deflate")).getReader();
  const bytes = new Uint8Array(LABEL_BYTES);
  let size = 0;
  try {
    while (size < LABEL_BYTES) {
      const { value, done } = await reader.read();
      if (done) break;
      bytes.set(value.subarray(0, LABEL_BYTES - size), size);
      size += Math.min(value.length, LABEL_BYTES - size);
    }
  } catch {
    // Damaged, or cut at the label's bound: what came before is read.
  }
  reader.cancel().catch(() => {});
  return new DataView(bytes.buffer, 0, size);
}

/// The text variables of a MAT v5 file: its numbers are stepped over, so that a large file is read as fast as a small one.
async function matLabels(file) {
  const labels = {};
  const head = new DataView(await file.slice(0, 128).arrayBuffer());
  if (head.byteLength < 128) return labels;
  const little = head.getUint8(126) === 0x49;
  for (let at = 128, count = 0; at + 8 <= file.size && count < VARIABLES; ++count) {
    const tag = new DataView(await file.slice(at, at + 8).arrayBuffer());
    const [type, size] = [tag.getUint32(0, little), tag.getUint32(4, little)];
    let element = null;
    if (type === MATRIX) element = new DataView(await file.slice(at, at + 8 + Math.min(size, LABEL_BYTES)).arrayBuffer());
    else if (type === PACKED) element = await unpacked(file.slice(at + 8, at + 8 + Math.min(size, LABEL_BYTES)));
    else break;
    const [name, text] = textVariable(element, little) ?? [];
    if (text) labels[name] ??= text;
    at += 8 + size;
  }
  return labels;
}

/// What the file says of itself, by key; null where the browser cannot tell (packed by zstd, a packed MAT file, a very
/// large JSON): the server reads those as they come in.
export async function labelsOf(file) {
  if (/\.json(\.gz)?$/i.test(file.name)) return jsonLabels(file);
  if (/\.mat$/i.test(file.name)) return matLabels(file);
  if (!/\.(csv|txt)(\.gz)?$/i.test(file.name)) return null;
  return headLabels(await headOf(file, HEAD_BYTES));
}
