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
  const own = process.env.CHROMIUM || installed();
  const common = { headless: "shell", defaultViewport: { width: 1400, height: 1000 } };
  if (own !== undefined) {
    // As root, as in a container, Chromium's own sandbox does not start. The page is one that we have made.
    const args = process.getuid() === 0 ? ["--no-sandbox"] : [];
    return puppeteer.launch({ ...common, executablePath: own, args });
  }
  return puppeteer.launch({ ...common, executablePath: await packaged.executablePath(), args: packaged.args });
}
