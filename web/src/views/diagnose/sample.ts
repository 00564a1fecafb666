// A generated sample: throws of a table tennis ball as a camera would track them. The same file every time.

/** Physics of the sample: a ball of 2.7 g and 40 mm in air at 20 degrees Celsius. */
const GRAVITY_MPS2 = 9.81;
/** Coefficient of quadratic drag: density of air 1.2 kg/m^3, drag coefficient 0.47, cross section 1.26e-3 m^2, mass 2.7 g. */
export const SAMPLE_DRAG_PER_M = 0.131;
const [THROWS, FRAMES, FPS, NOISE_M] = [14, 40, 60, 0.001];
/** Integration steps of a frame. */
const STEPS_PER_FRAME = 20;
const SEED = 20;

export const SAMPLE_NAME = "sample-throws.csv";
export const SAMPLE_NOTE = `A generated sample, not a measurement: ${THROWS} throws of a table tennis ball, simulated with air drag, with 1 mm of noise, at ${FPS} frames per second.`;

/** The sample as a CSV file. */
export function sampleCsv(): string {
  const random = generator(SEED);
  const uniform = (low: number, high: number): number => low + (high - low) * random();
  const gauss = (): number => Math.sqrt(-2 * Math.log(1 - random())) * Math.cos(2 * Math.PI * random());
  const lines = ["trial,t (s),x (m),y (m)"];
  for (let i = 1; i <= THROWS; i++) {
    const velocity: [number, number] = [uniform(2.5, 9), uniform(-0.5, 4.5)];
    flight([0, uniform(1.2, 1.6)], velocity).forEach(([x, y], frame) => {
      lines.push(`throw ${i},${(frame / FPS).toFixed(4)},${(x + NOISE_M * gauss()).toFixed(4)},${(y + NOISE_M * gauss()).toFixed(4)}`);
    });
  }
  return `${lines.join("\n")}\n`;
}

/** Positions at each frame, by the midpoint rule. */
function flight([x, y]: [number, number], [vx, vy]: [number, number]): [number, number][] {
  const dt = 1 / FPS / STEPS_PER_FRAME;
  const acceleration = (ux: number, uy: number): [number, number] => {
    const speed = Math.hypot(ux, uy);
    return [-SAMPLE_DRAG_PER_M * speed * ux, -GRAVITY_MPS2 - SAMPLE_DRAG_PER_M * speed * uy];
  };
  const positions: [number, number][] = [];
  for (let frame = 0; frame < FRAMES; frame++) {
    positions.push([x, y]);
    for (let k = 0; k < STEPS_PER_FRAME; k++) {
      const [ax, ay] = acceleration(vx, vy);
      const [mx, my] = [vx + 0.5 * dt * ax, vy + 0.5 * dt * ay];
      const [bx, by] = acceleration(mx, my);
      [x, y, vx, vy] = [x + dt * mx, y + dt * my, vx + dt * bx, vy + dt * by];
    }
  }
  return positions;
}

/** Uniform numbers in [0, 1): mulberry32 (Tommy Ettinger 2017, public domain). */
function generator(seed: number): () => number {
  let state = seed;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}
