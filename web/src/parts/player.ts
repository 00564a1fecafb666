// The film player: real time, pause, scrubbing, speed.

import { uniqueId, h, put, set } from "../dom";
import { short } from "./slider";

export interface Player {
  element: HTMLElement;
  /** Loads a film of another length, s, keeping the time. */
  load: (length: number) => void;
  /** Plays from the start. */
  restart: () => void;
  /** Seeks to a time, s, and pauses. */
  seek: (time: number) => void;
  time: () => number;
}

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

/** `onFrame` is called for every frame with its time, s. */
export function player(onFrame: (time: number) => void, signal: AbortSignal): Player {
  let [time, length, speed, playing, before, frameRequest] = [0, 0, 1, false, 0, 0];
  const [scrubId, speedId] = [uniqueId("scrub"), uniqueId("speed")];
  const toggle = h("button", { type: "button", class: "play" });
  const scrub = h("input", { id: scrubId, type: "range", min: 0, max: 0, step: 0.001, "aria-label": "Time" });
  const clock = h("output", { for: scrubId, class: "clock" });
  const choice = h("select", { id: speedId }, ...SPEEDS.map((v) => h("option", { value: v, selected: v === 1 }, `${v} ×`)));
  const element = h("div", { class: "player" }, toggle, scrub, clock, h("label", { for: speedId, class: "unseen" }, "Speed"), choice);
  const show = (): void => {
    put(toggle, playing ? "❚❚" : "▶");
    set(toggle, { "aria-label": playing ? "Pause" : "Play" });
    scrub.max = String(length);
    scrub.value = String(time);
    const text = `${time.toFixed(2)} of ${short(length, "s")}`;
    set(scrub, { "aria-valuetext": text });
    put(clock, text);
    onFrame(time);
  };
  const tick = (now: number): void => {
    if (!playing || signal.aborted) return;
    // A hidden tab continues where it stopped.
    time += Math.min(now - before, 100) * 1e-3 * speed;
    before = now;
    if (time >= length) [time, playing] = [length, false];
    show();
    if (playing) frameRequest = requestAnimationFrame(tick);
  };
  const play = (): void => {
    if (playing || length === 0) return;
    if (time >= length) time = 0;
    [playing, before] = [true, performance.now()];
    show();
    frameRequest = requestAnimationFrame(tick);
  };
  const pause = (): void => {
    playing = false;
    cancelAnimationFrame(frameRequest);
    show();
  };
  toggle.addEventListener("click", () => (playing ? pause() : play()));
  const seek = (to: number): void => {
    time = Math.min(length, Math.max(0, to));
    pause();
  };
  scrub.addEventListener("input", () => seek(Number(scrub.value)));
  choice.addEventListener("change", () => (speed = Number(choice.value)));
  signal.addEventListener("abort", () => cancelAnimationFrame(frameRequest));
  show();
  return {
    element,
    load: (now) => {
      length = now;
      time = Math.min(time, length);
      show();
    },
    restart: () => {
      time = 0;
      // With reduced motion, playback starts manually.
      if (matchMedia("(prefers-reduced-motion: reduce)").matches) show();
      else play();
    },
    seek,
    time: () => time,
  };
}
