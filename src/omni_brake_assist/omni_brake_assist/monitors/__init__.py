"""Monitors that detect failed brakes and braking with too little effect."""
