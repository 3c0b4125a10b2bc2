// Finds a Chromium and starts it.

import { execFileSync } from "node:child_process";
import packaged from "@sparticuz/chromium";
import puppeteer from "puppeteer-core";

const NAMES = ["chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"];

/** A browser that is installed, if there is one. */
function installed() {
  for (const name of NAMES) {
    try {
      return execFileSync("which", [name], { encoding: "utf8", stdio: ["ignore", "pipe", "ignore"] }).trim();
    } catch {
      // Not this one.
    }
  }
  return undefined;
}

/** Starts $CHROMIUM, an installed browser, or the one of the npm package. */
export async function start() {
  const program = process.env.CHROMIUM || installed() || (await packaged.executablePath());
  // As root, as in a container, Chromium's own sandbox does not start. The page is one that we have made.
  const args = process.getuid() === 0 ? ["--no-sandbox"] : [];
  // On a machine without a language Chromium claims one that its own formatter of numbers refuses.
  const env = { ...process.env, LC_ALL: "en_US.UTF-8", LANGUAGE: "en_US" };
  const defaultViewport = { width: 1400, height: 1000 };
  return puppeteer.launch({ headless: "shell", executablePath: program, args, env, defaultViewport });
}
