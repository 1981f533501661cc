// The socket: says the token first, answers each status with a heartbeat, gives every reply to whoever asked. Knows no picture.

const CHANNELS = 6;
/** Statuses come ten times a second; a line without any for so long is lost, whatever the browser still thinks of it. */
const SILENCE_MS = 2500;
export const KIND = { live: 1, past: 2, capture: 3, points: 4, spectrum: 5 };

/** A frame's bytes as columns; the layout stands in bench-page/src/watch.rs. */
function unpack(buffer) {
  const view = new DataView(buffer);
  const n = view.getUint32(8, true);
  const frame = {
    kind: view.getUint32(0, true), id: view.getUint32(4, true), n,
    first: view.getFloat64(16, true), length: view.getFloat64(24, true), mark: view.getFloat64(32, true),
    least: [], most: [], limits: null,
  };
  let at = 40;
  for (let channel = 0; channel < CHANNELS; channel++) {
    frame.least.push(new Float32Array(buffer, at, n));
    frame.most.push(new Float32Array(buffer, at + 4 * n, n));
    at += 8 * n;
  }
  frame.limits = new Uint8Array(buffer, at, n);
  return frame;
}

export class Bench extends EventTarget {
  constructor(token) {
    super();
    this.token = token;
    this.asked = new Map();
    this.next = 1;
    this.open();
    setInterval(() => this.watch(), 500);
  }

  open() {
    this.refused = null;
    this.heard = 0;
    this.socket = new WebSocket(`ws://${location.host}/socket`);
    this.socket.binaryType = 'arraybuffer';
    this.socket.onopen = () => this.socket.send(JSON.stringify({ token: this.token }));
    this.socket.onmessage = (event) => this.take(event.data);
    this.socket.onclose = () => this.close();
  }

  close() {
    for (const { reject } of this.asked.values()) reject(new Error('the connection is lost'));
    this.asked.clear();
    this.tell('closed', Boolean(this.refused));
    // A stale token stays stale; everything else may come back, and a page be closed where there were too many.
    if (!this.refused?.is_final) setTimeout(() => this.open(), 1000);
  }

  /** A network that is gone closes nothing for minutes. */
  watch() {
    const { socket } = this;
    if (!this.heard || socket.readyState !== WebSocket.OPEN || performance.now() - this.heard < SILENCE_MS) return;
    socket.onclose = null;
    socket.onmessage = null;
    socket.close();
    this.close();
  }

  take(data) {
    if (typeof data !== 'string') return this.tell('frame', unpack(data));
    const message = JSON.parse(data);
    if (message.kind === 'status') { this.heard = performance.now(); this.say('beat'); }
    if (message.kind === 'reply') {
      const asked = this.asked.get(message.id);
      this.asked.delete(message.id);
      if (!asked) return undefined;
      return message.ok ? asked.resolve(message) : asked.reject(new Error(message.text));
    }
    if (message.kind === 'refused') this.refused = message;
    return this.tell(message.kind, message);
  }

  tell(kind, detail) {
    this.dispatchEvent(new CustomEvent(kind, { detail }));
  }

  /** Sends a request that has no answer, or whose answer is a frame; its number. */
  say(what, more = {}) {
    const id = this.next++;
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ id, do: what, ...more }));
    return id;
  }

  /** Sends a request; resolves with its answer, fails with its words. */
  ask(what, more = {}) {
    return new Promise((resolve, reject) => {
      if (this.socket.readyState !== WebSocket.OPEN) return reject(new Error('there is no connection to the bench'));
      const id = this.say(what, more);
      return this.asked.set(id, { resolve, reject });
    });
  }
}
