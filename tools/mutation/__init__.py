"""Mutation test of the firmware: does any test notice?"""
