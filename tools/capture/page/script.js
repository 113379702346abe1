"use strict";

const POLL = 500; // milliseconds
const MUCH = 0.01; // of the samples clipped, from which on it is shown as a fault
const page = document.body;
const [state, size, picture, flash, rate, latency, dropped, clipped, shutter, message] =
  ["state", "size", "picture", "flash", "rate", "latency", "dropped", "clipped", "shutter", "message"].map((id) => document.getElementById(id));

function say(text, failed = false) {
  message.textContent = text;
  message.classList.toggle("failed", failed);
}

function become(name, text) {
  page.dataset.state = name;
  state.textContent = text;
}

function figures(...texts) {
  [rate, latency, dropped, clipped].forEach((place, index) => { place.textContent = texts[index] ?? "–"; });
}

function percent(part) {
  if (part === 0) return "0 %";
  return part < 0.001 ? "< 0.1 %" : `${(100 * part).toFixed(part < 0.1 ? 1 : 0)} %`;
}

function show(status) {
  const live = status.frames && !status.silent;
  const speed = status.fps && status.fps < 1 ? status.fps.toPrecision(2) : status.fps.toFixed(1);
  const shown = status.frames ? [status.fps || !live ? speed : "–", `${Math.round(status.latency_ms)} ms`] : ["–", "–"];
  figures(...shown, status.dropped, status.frames ? percent(status.clipped) : "–");
  clipped.classList.toggle("failed", status.clipped > MUCH);
  size.textContent = status.frames ? `${status.width} × ${status.height}` : "";
  shutter.disabled = !status.can_save || !status.frames;
  if (!status.can_save) say("to save shots, start panchroma view with -o DIR");
  // Live only when a picture has arrived.
  if (live && picture.naturalWidth > 0) become("live", "live");
  else if (status.frames) become("silent", live ? "waiting for the picture" : "no new frames from the camera");
  else become("waiting", "waiting for the first frame");
}

async function poll() {
  try {
    const answer = await fetch("status", { cache: "no-store", signal: AbortSignal.timeout(4 * POLL) });
    if (!answer.ok) throw new Error(answer.statusText);
    // A broken stream does not restart by itself.
    if (page.dataset.state === "lost") picture.src = `stream.mjpg?${Date.now()}`;
    show(await answer.json());
  } catch {
    shutter.disabled = true;
    figures();
    become("lost", "no connection to the camera");
  }
  setTimeout(poll, POLL);
}

async function capture() {
  shutter.disabled = true;
  shutter.classList.add("busy");
  flash.classList.remove("on");
  void flash.offsetWidth; // restarts the animation
  flash.classList.add("on");
  try {
    const answer = await fetch("capture", { method: "POST" });
    const shot = await answer.json();
    say(answer.ok ? `✓ ${shot.file} · ${Math.round(shot.write_ms)} ms` : shot.error, !answer.ok);
  } catch {
    say("not saved: no connection to the camera", true);
  }
  shutter.classList.remove("busy");
  shutter.disabled = false;
}

shutter.addEventListener("click", capture);
picture.addEventListener("error", () => setTimeout(() => { picture.src = `stream.mjpg?${Date.now()}`; }, 2 * POLL));
poll();
